// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/clock_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "mapper/cli/log_file.h"
#include "mapstore/codec/run_log.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/median.h"

namespace shiftmap {
namespace {

// Clocks that are set by a network differ by less. [s]
constexpr double kToleranceS = 60.0;

// Beyond it maps are made of recorded data, and the clock of the machine says nothing of a run.
constexpr double kLiveS = 86'400.0;

// Without an item for so long. [s]
constexpr double kJumpS = 3600.0;

// A run that takes so much longer than others to come, and longer than this, is late.
constexpr double kLateFactor = 10.0;
constexpr double kLateS = 3600.0;

std::string Utc(Stamp stamp) { return FormatUtc(stamp) + " UTC"; }

std::string Quoted(const std::string& vehicle) {
  return fmt::format("vehicle '{}'", InertLine(vehicle));
}

bool Same(const RunRecord& run, const std::string& id) {
  return id == run.identity() || id == run.sha256;
}

class ClockCheck {
 public:
  ClockCheck(std::string area, const JudgedVersion& version, MapStore* store)
      : area_(std::move(area)), version_(version), store_(store) {}

  Status Start() {
    if (!version_.parent) return OkStatus();  // Nothing came of an area without a map.
    SHIFTMAP_ASSIGN_OR_RETURN(received_, store_->ReceivedRuns(area_));
    SHIFTMAP_ASSIGN_OR_RETURN(versions_, store_->Versions(area_));
    return OkStatus();
  }

  // Why a run's clock is wrong; nothing: it is not, as far as is known.
  StatusOr<std::optional<std::string>> Wrong(const RunRecord& run, const LogHead& log) {
    if (std::optional<std::string> jump = Jump(log)) return jump;
    if (std::optional<std::string> other = InTwoRuns(run)) return other;
    const std::optional<Stamp> handed_in = HandedIn(run, log);
    if (handed_in && run.end > *handed_in + FromSeconds(kToleranceS)) {
      return std::optional(fmt::format("its clock is ahead: it ends at {}, and was handed in at {}",
                                       Utc(run.end),
                                       Utc(*handed_in)));
    }
    return BeforeItsMap(run);
  }

  // What is odd about a run's times and decides nothing.
  std::optional<std::string> Doubt(const RunRecord& run, const LogHead& log) const {
    const std::optional<Stamp> handed_in = HandedIn(run, log);
    const std::optional<double> usual = UsualDelay(run);
    if (!handed_in || !usual) return std::nullopt;
    const double delay = ToSeconds(*handed_in - run.end);
    if (delay <= std::max(kLateS, kLateFactor * *usual)) return std::nullopt;
    return fmt::format(
        "'{}' was handed in {:.1f} h after it ends, others {:.1f} h in the median: it is late, or "
        "the clock of {} is behind; nothing tells which",
        log.path,
        delay / 3600.0,
        *usual / 3600.0,
        Quoted(run.vehicle));
  }

 private:
  // A clock that is set while a vehicle drives leaves a gap in its log. A recorder that pauses for
  // as long begins another one.
  static std::optional<std::string> Jump(const LogHead& log) {
    const StatusOr<RunLog> read = ReadRunLog(log.path, {.lidar_scans = false});
    if (!read.ok()) return std::nullopt;  // The build has read it.
    std::vector<Stamp> stamps;
    for (const OdometrySample& sample : read->run.odometry) stamps.push_back(sample.stamp);
    for (const Scan& scan : read->run.scans) stamps.push_back(scan.stamp);
    std::sort(stamps.begin(), stamps.end());
    const auto gap = std::adjacent_find(
        stamps.begin(), stamps.end(), [](Stamp a, Stamp b) { return b - a > FromSeconds(kJumpS); });
    if (gap == stamps.end()) return std::nullopt;
    return fmt::format(
        "its clock was set, or two runs are in it: there is nothing for {:.1f} h "
        "after {}",
        ToSeconds(*(gap + 1) - *gap) / 3600.0,
        Utc(*gap));
  }

  std::optional<Stamp> HandedIn(const RunRecord& run, const LogHead& log) const {
    std::optional<Stamp> first = ChangedAt(log.path);
    for (const ReceivedRun& of : received_) {
      if (Same(run, of.run) && (!first || of.received < *first)) first = of.received;
    }
    return first;
  }

  // A vehicle is in one run at a time.
  std::optional<std::string> InTwoRuns(const RunRecord& run) const {
    if (run.vehicle.empty()) return std::nullopt;
    const auto other =
        std::find_if(version_.rows.begin(), version_.rows.end(), [&](const auto& of) {
          return of.vehicle == run.vehicle && of.source != run.sha256 &&
                 of.evidence.begin < run.end && of.evidence.end > run.begin;
        });
    if (other == version_.rows.end()) return std::nullopt;
    const std::string when = Utc(other->evidence.begin);
    const bool both = std::any_of(version_.provenance.runs.begin(),
                                  version_.provenance.runs.end(),
                                  [&](const RunRecord& of) { return of.sha256 == other->source; });
    if (!both) {
      return fmt::format(
          "its clock is wrong: {} was in another run at {}", Quoted(run.vehicle), when);
    }
    return fmt::format(
        "its clock is wrong, or that of another log of this night: {} was in both "
        "at {}, and nothing tells which",
        Quoted(run.vehicle),
        when);
  }

  // How long after their end the runs of others came. [s]
  std::optional<double> UsualDelay(const RunRecord& run) const {
    std::vector<double> delays;
    for (const ReceivedRun& of : received_) {
      if (of.vehicle.empty() || Same(run, of.run)) continue;
      delays.push_back(ToSeconds(of.received - of.end));
    }
    if (delays.empty()) return std::nullopt;
    return Median(std::move(delays));
  }

  StatusOr<std::optional<std::string>> BeforeItsMap(const RunRecord& run) {
    const auto report = std::find_if(received_.begin(), received_.end(), [&](const auto& of) {
      return of.driven_on && Same(run, of.run);
    });
    if (report == received_.end()) return std::optional<std::string>();
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<Stamp> made, MadeAt(run, *report->driven_on));
    if (!made || run.begin >= *made - FromSeconds(kToleranceS)) return std::optional<std::string>();
    return std::optional(
        fmt::format("its clock is behind: it begins at {}, and was driven on version {}, which was "
                    "not made before {}",
                    Utc(run.begin),
                    report->driven_on->value(),
                    Utc(*made)));
  }

  // When most runs of a version had ended: one wrong clock among them makes no other wrong.
  StatusOr<std::optional<Stamp>> MostEnded(VersionNumber version) {
    if (const auto known = ended_.find(version); known != ended_.end()) return known->second;
    SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance, store_->LoadProvenance(area_, version));
    std::vector<Stamp> ends;
    for (const RunRecord& of : provenance.runs) ends.push_back(of.end);
    std::sort(ends.begin(), ends.end());
    std::optional<Stamp>& ended = ended_[version];
    if (!ends.empty()) ended = ends[(ends.size() - 1) / 2];
    return ended;
  }

  // From when on a version can have been driven on.
  StatusOr<std::optional<Stamp>> MadeAt(const RunRecord& run, VersionNumber version) {
    SHIFTMAP_ASSIGN_OR_RETURN(std::optional<Stamp> made, MostEnded(version));
    const std::optional<double> usual = UsualDelay(run);
    if (!usual || *usual > kLiveS) return made;
    for (const VersionSummary& of : versions_) {
      if (of.version == version && (!made || of.created > *made)) made = of.created;
    }
    return made;
  }

  const std::string area_;
  const JudgedVersion& version_;
  MapStore* store_;
  std::vector<ReceivedRun> received_;
  std::vector<VersionSummary> versions_;
  std::map<VersionNumber, std::optional<Stamp>> ended_;  // Of versions that were driven on.
};

}  // namespace

Status CheckClocks(const std::string& area,
                   const JudgedVersion& version,
                   const std::vector<LogHead>& logs,
                   MapStore* store,
                   Judgement* judgement) {
  ClockCheck check(area, version, store);
  SHIFTMAP_RETURN_IF_ERROR(check.Start());
  for (const RunRecord& run : version.provenance.runs) {
    const auto log = std::find_if(
        logs.begin(), logs.end(), [&](const LogHead& of) { return Same(run, of.identity()); });
    if (log == logs.end()) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<std::string> wrong, check.Wrong(run, *log));
    if (wrong) {
      judgement->suspects.push_back({log->path, *wrong});
    } else if (std::optional<std::string> doubt = check.Doubt(run, *log)) {
      judgement->doubts.push_back(*std::move(doubt));
    }
  }
  return OkStatus();
}

}  // namespace shiftmap
