// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/check/log_check.h"

#include <fmt/format.h>

#include <algorithm>

#include "localizer/models/motion_model.h"

namespace shiftmap {
namespace {

// 2000-01-01; no robot's clock was right before.
constexpr std::int64_t kEarliestSeconds = 946'684'800;

// Odometry more often than this is stamped in another unit.
constexpr double kMinIntervalS = 1e-4;

// Slower odometry misses turns.
constexpr double kSlowIntervalS = 0.5;

}  // namespace

LogCheck::LogCheck(const LogCheckOptions& options)
    : options_(options),
      odometry_times_("odometry"),
      scan_times_("scans"),
      odometry_(options.limits),
      scans_(options.limits) {}

void LogCheck::Add(const RunEvent& event) {
  const Stamp stamp = StampOf(event);
  if (newest_ && stamp < *newest_) {
    ++late_;
    if (*newest_ - stamp > worst_lateness_) {
      worst_lateness_ = *newest_ - stamp;
      latest_at_ = stamp;
    }
  }
  newest_ = newest_ ? std::max(*newest_, stamp) : stamp;
  if (const auto* sample = std::get_if<OdometrySample>(&event)) {
    odometry_times_.Add(stamp);
    odometry_.Add(*sample);
    motion_.Add(*sample);
    lag_.Add(*sample);
  } else if (const auto* scan = std::get_if<Scan>(&event)) {
    scan_times_.Add(stamp);
    scans_.Add(*scan);
    motion_.Add(*scan);
    lag_.Add(*scan);
  } else {
    ++lidar_scans_;
  }
}

void LogCheck::CheckInfo(const RunInfo& info, Findings* findings) const {
  if (info.vehicle.empty()) {
    findings->push_back({Severity::kWarning,
                         "no_vehicle",
                         "run info",
                         "the log does not name its vehicle",
                         "name it: what one vehicle says of a map is kept apart from the others"});
  }
  if (info.area.empty()) {
    findings->push_back({Severity::kNote,
                         "no_area",
                         "run info",
                         "the log does not name its area",
                         "name it, so that it is mapped in no other"});
  }
  if (info.uuid.empty()) {
    findings->push_back({Severity::kNote,
                         "no_run_uuid",
                         "run info",
                         "the log has no run UUID: the hash of the file stands for it",
                         "draw one when the log begins, so that copies count once"});
  }
}

void LogCheck::CheckClock(Findings* findings) const {
  const Stamp begin = odometry_times_.begin();
  const Stamp end = std::max(odometry_times_.end(), *newest_);
  const double interval_s = odometry_times_.MedianInterval().value_or(1.0);
  if (interval_s < kMinIntervalS) {
    findings->push_back(
        {Severity::kError,
         "stamp_unit",
         "odometry",
         fmt::format("a sample every {:.3g} s: stamps are in another unit", interval_s),
         "a stamp is nanoseconds since 1970: seconds times 1e9, milliseconds times "
         "1e6"});
  } else if (ToNanoseconds(begin) < kEarliestSeconds * 1'000'000'000) {
    findings->push_back({Severity::kWarning,
                         "stamp_epoch",
                         "odometry",
                         "the log begins at " + FormatUtc(begin),
                         "stamp with the time of day, not the time since the start: what was seen "
                         "last decides"});
  }
  const Status future = CheckNotInFuture("the log", end, options_.now, options_.clock_tolerance_s);
  if (!future.ok()) {
    findings->push_back({Severity::kError,
                         "stamp_future",
                         "log",
                         Message(future),
                         "set the recorder's clock; a map refuses what is yet to come"});
  }
  if (late_ > 0) {
    findings->push_back({Severity::kWarning,
                         "late_items",
                         fmt::format("log, {}", TimeInRun(latest_at_, begin)),
                         fmt::format("{} items are behind younger ones, by up to {:.6f} s",
                                     late_,
                                     ToSeconds(worst_lateness_)),
                         "write items in the order of their stamps"});
  }
  if (interval_s > kSlowIntervalS) {
    findings->push_back({Severity::kWarning,
                         "odometry_slow",
                         "odometry",
                         fmt::format("a sample every {:.2f} s", interval_s),
                         "log odometry ten times a second or more"});
  }
}

void LogCheck::CheckOverlap(Findings* findings) const {
  if (scan_times_.count() == 0) {
    findings->push_back({Severity::kError,
                         "no_scans",
                         "scans",
                         "the log has no scans of landmarks",
                         "see whether the detector ran, and its topic was recorded"});
    return;
  }
  const Stamp begin = odometry_times_.begin();
  if (scan_times_.begin() > odometry_times_.end() || scan_times_.end() < begin) {
    findings->push_back(
        {Severity::kError,
         "no_overlap",
         fmt::format("scans, {}", TimeInRun(scan_times_.begin(), begin)),
         "all scans are before or after the odometry: they are stamped by different clocks",
         "stamp both by one clock, or synchronize the clocks"});
    return;
  }
  const double before_s = ToSeconds(begin - scan_times_.begin());
  const double after_s = ToSeconds(scan_times_.end() - odometry_times_.end());
  const double longest_s = std::max(before_s, after_s);
  if (longest_s <= kOdometryHold) return;
  findings->push_back({Severity::kWarning,
                       "scans_without_odometry",
                       fmt::format("scans, {}", before_s > after_s ? "begin" : "end"),
                       fmt::format("scans go on for {:.1f} s without odometry", longest_s),
                       "begin and end the recording of both together; the pose is a guess there"});
}

// A log with a mistake of signs or units fits at no lag.
void LogCheck::CheckMotion(Findings* findings) const {
  const std::size_t before = findings->size();
  motion_.Report(findings);
  const bool mistaken = std::any_of(
      findings->begin() + static_cast<std::ptrdiff_t>(before), findings->end(), [](const auto& f) {
        return f.severity == Severity::kWarning && f.code != "motion_misfit";
      });
  if (!mistaken) lag_.Report(findings);
}

Findings LogCheck::Finish(const RunInfo& info) const {
  Findings findings;
  if (odometry_times_.count() == 0) {
    findings.push_back({Severity::kError,
                        "no_odometry",
                        "odometry",
                        "the log has no odometry",
                        "see whether its topic was recorded"});
  }
  CheckInfo(info, &findings);
  if (odometry_times_.count() > 0) {
    const Stamp begin = odometry_times_.begin();
    CheckClock(&findings);
    CheckOverlap(&findings);
    odometry_times_.Report(begin, &findings);
    if (scan_times_.count() > 0) scan_times_.Report(begin, &findings);
    odometry_.Report(begin, &findings);
    scans_.Report(begin, &findings);
    if (scans_.observations() > 0) CheckMotion(&findings);
  }
  std::stable_sort(findings.begin(), findings.end(), [](const Finding& a, const Finding& b) {
    return a.severity > b.severity;
  });
  return findings;
}

}  // namespace shiftmap
