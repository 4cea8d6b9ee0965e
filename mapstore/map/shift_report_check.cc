// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/shift_report_check.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <string>
#include <tuple>
#include <vector>

#include "mapstore/core/magnitude.h"
#include "mapstore/core/stamp_check.h"
#include "mapstore/core/utf8.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr std::size_t kUuidLength = 36;
constexpr std::size_t kSha256HexLength = 64;

// Of differences of log-likelihoods. [nat]
constexpr double kRounding = 1e-6;

bool IsLowerHex(char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); }

bool IsHex(char c) { return IsLowerHex(c) || (c >= 'A' && c <= 'F'); }

Status CheckNumber(std::string_view field, double value) {
  if (std::abs(value) <= kMaxMagnitude) return OkStatus();
  return InvalidArgument("{}: {}, expected a finite number up to {}", field, value, kMaxMagnitude);
}

// The span of something in a shift, which `shift` is.
Status CheckSpan(std::string_view field, Stamp begin, Stamp end, const ShiftReport& shift) {
  if (shift.begin <= begin && begin <= end && end <= shift.end) return OkStatus();
  return InvalidArgument("{}: {:.6f} s to {:.6f} s, expected in order and within {:.6f}..{:.6f}",
                         field,
                         ToSecondsSinceEpoch(begin),
                         ToSecondsSinceEpoch(end),
                         ToSecondsSinceEpoch(shift.begin),
                         ToSecondsSinceEpoch(shift.end));
}

Status CheckHead(const ShiftReport& report) {
  if (!IsUuid(report.uuid)) return InvalidArgument("uuid: not an RFC 4122 UUID");
  SHIFTMAP_RETURN_IF_ERROR(CheckReportText("vehicle", report.vehicle));
  SHIFTMAP_RETURN_IF_ERROR(CheckReportText("area", report.area));
  SHIFTMAP_RETURN_IF_ERROR(CheckReportText("software", report.software));
  if (report.version.value() < 1) {
    return InvalidArgument("version: {}, expected 1 or more", report.version.value());
  }
  if (!IsSha256Hex(report.content_hash)) {
    return InvalidArgument("content_hash: not a SHA-256 in lower-case hex");
  }
  if (!report.run_hash.empty() && !IsSha256Hex(report.run_hash)) {
    return InvalidArgument("run_hash: neither empty nor a SHA-256 in lower-case hex");
  }
  if (!report.run_uuid.empty() && !IsUuid(report.run_uuid)) {
    return InvalidArgument("run_uuid: neither empty nor an RFC 4122 UUID");
  }
  for (const Stamp stamp : {report.begin, report.end}) {
    if (const Status status = ValidateStamp(stamp); !status.ok()) {
      return InvalidArgument("begin_ns, end_ns: {}", Message(status));
    }
  }
  return CheckSpan("begin_ns, end_ns", report.begin, report.end, report);
}

Status CheckEvidence(const std::string& field,
                     const VisitEvidence& visit,
                     const ShiftReport& report) {
  SHIFTMAP_RETURN_IF_ERROR(CheckReportText(field + ".signature", visit.signature.text()));
  SHIFTMAP_RETURN_IF_ERROR(CheckSpan(field, visit.begin, visit.end, report));
  if (visit.observations < 0) {
    return InvalidArgument(
        "{}.observation_count: {}, expected 0 or more", field, visit.observations);
  }
  if (visit.modes.empty() || visit.modes.front().mode != kAbsent) {
    return InvalidArgument("{}.mode: does not begin with mode 0", field);
  }
  double least = visit.modes.front().log_likelihood;
  double largest = least;
  for (std::size_t i = 0; i < visit.modes.size(); ++i) {
    const std::string mode_field = fmt::format("{}.mode[{}]", field, i);
    const auto& [mode, log_likelihood] = visit.modes[i];
    if (i > 0 && mode <= visit.modes[i - 1].mode) {
      return InvalidArgument("{}.mode: {} after {}, expected ascending numbers",
                             mode_field,
                             mode.value(),
                             visit.modes[i - 1].mode.value());
    }
    SHIFTMAP_RETURN_IF_ERROR(CheckNumber(mode_field + ".log_likelihood", log_likelihood));
    least = std::min(least, log_likelihood);
    largest = std::max(largest, log_likelihood);
  }
  if (largest - least <= kMaxVisitLogRatio + kRounding) return OkStatus();
  return InvalidArgument("{}.mode: log-likelihoods from {} to {}, expected at most {} apart",
                         field,
                         least,
                         largest,
                         kMaxVisitLogRatio);
}

Status CheckDecision(const std::string& field,
                     const Decision& decision,
                     const ShiftReport& report) {
  SHIFTMAP_RETURN_IF_ERROR(CheckReportText(field + ".signature", decision.signature.text()));
  if (decision.mode < kAbsent) {
    return InvalidArgument("{}.mode: {}, expected 0 or more", field, decision.mode.value());
  }
  SHIFTMAP_RETURN_IF_ERROR(CheckNumber(field + ".log_odds", decision.log_odds));
  return CheckSpan(field + ".stamp_ns", decision.stamp, decision.stamp, report);
}

Status CheckSighting(const std::string& field,
                     const UnmappedSighting& sighting,
                     const ShiftReport& report) {
  if (!sighting.signature.anonymous()) {
    SHIFTMAP_RETURN_IF_ERROR(CheckReportText(field + ".signature", sighting.signature.text()));
  }
  SHIFTMAP_RETURN_IF_ERROR(CheckNumber(field + ".x_m", sighting.p_map_landmark.x()));
  SHIFTMAP_RETURN_IF_ERROR(CheckNumber(field + ".y_m", sighting.p_map_landmark.y()));
  if (!IsSymmetricPositiveDefinite(sighting.cov_p_map_landmark) ||
      sighting.cov_p_map_landmark.maxCoeff() > kMaxVariance) {
    return InvalidArgument(
        "{}: covariance is not positive definite, or above {}", field, kMaxVariance);
  }
  if (sighting.count < 1) {
    return InvalidArgument("{}.count: {}, expected 1 or more", field, sighting.count);
  }
  return CheckSpan(field, sighting.first, sighting.last, report);
}

Status CheckDropped(const std::string& field, const DroppedCount& dropped, const ShiftReport&) {
  SHIFTMAP_RETURN_IF_ERROR(CheckReportText(field + ".reason", dropped.reason));
  if (dropped.count < 0) {
    return InvalidArgument("{}.count: {}, expected 0 or more", field, dropped.count);
  }
  return OkStatus();
}

template <typename Item, typename Check>
Status CheckAll(const char* name,
                const std::vector<Item>& items,
                const ShiftReport& report,
                Check check) {
  for (std::size_t i = 0; i < items.size(); ++i) {
    SHIFTMAP_RETURN_IF_ERROR(check(fmt::format("{}[{}]", name, i), items[i], report));
  }
  return OkStatus();
}

auto KeyOf(const VisitEvidence& visit) { return std::tie(visit.signature, visit.begin, visit.end); }

// Indices of the visits that are at the time of an earlier one of the same landmark, ascending.
std::vector<std::size_t> Repetitions(const std::vector<VisitEvidence>& evidence) {
  std::vector<std::size_t> order(evidence.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return std::tuple_cat(KeyOf(evidence[a]), std::tie(a)) <
           std::tuple_cat(KeyOf(evidence[b]), std::tie(b));
  });
  std::vector<std::size_t> repeated;
  for (std::size_t i = 1; i < order.size(); ++i) {
    const bool same = KeyOf(evidence[order[i - 1]]) == KeyOf(evidence[order[i]]);
    if (same) repeated.push_back(order[i]);
  }
  std::sort(repeated.begin(), repeated.end());
  return repeated;
}

void CountDropped(const std::string& reason, std::size_t count, ShiftReport* report) {
  if (count == 0) return;
  const auto known = std::find_if(
      report->dropped.begin(), report->dropped.end(), [&](const DroppedCount& dropped) {
        return dropped.reason == reason;
      });
  DroppedCount& dropped = known != report->dropped.end()
                              ? *known
                              : report->dropped.emplace_back(DroppedCount{reason, 0});
  dropped.count += static_cast<std::int64_t>(count);
}

template <typename Item, typename Check>
void EraseInvalid(const char* reason,
                  Check check,
                  std::vector<Item> ShiftReport::*items,
                  ShiftReport* report) {
  const auto invalid = [&](const Item& item) { return !check("", item, *report).ok(); };
  CountDropped(reason, std::erase_if(report->*items, invalid), report);
}

// Bounds on the bytes that an item takes: a tag and at most 10 bytes of a varint, or 8 of a double,
// per field.
constexpr std::size_t kFieldBytes = 11;

std::size_t BytesOf(const VisitEvidence& visit) {
  return visit.signature.text().size() + (5 + 3 * visit.modes.size()) * kFieldBytes;
}
std::size_t BytesOf(const Decision& decision) {
  return decision.signature.text().size() + 5 * kFieldBytes;
}
std::size_t BytesOf(const UnmappedSighting& sighting) {
  return sighting.signature.text().size() + 10 * kFieldBytes;
}

template <typename Item>
std::size_t BytesOf(const std::vector<Item>& items) {
  return std::accumulate(
      items.begin(), items.end(), std::size_t{0}, [](auto sum, const Item& item) {
        return sum + BytesOf(item);
      });
}

// Takes out items until `excess` is 0, those of least `value` first and of these the latest.
template <typename Item, typename Value>
void EraseExcess(const char* reason,
                 Value value,
                 std::vector<Item> ShiftReport::*of_report,
                 std::size_t* excess,
                 ShiftReport* report) {
  std::vector<Item>& items = report->*of_report;
  std::vector<std::size_t> order(items.size());
  std::iota(order.rbegin(), order.rend(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return value(items[a]) < value(items[b]);
  });
  std::vector<bool> out(items.size());
  std::size_t count = 0;
  for (; count < order.size() && *excess > 0; ++count) {
    out[order[count]] = true;
    *excess -= std::min(*excess, BytesOf(items[order[count]]));
  }
  std::size_t i = 0;
  std::erase_if(items, [&](const Item&) { return out[i++]; });
  CountDropped(reason, count, report);
}

}  // namespace

bool IsUuid(std::string_view text) {
  if (text.size() != kUuidLength) return false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const bool dash = i == 8 || i == 13 || i == 18 || i == 23;
    if (dash ? text[i] != '-' : !IsHex(text[i])) return false;
  }
  return true;
}

std::string LowerCaseUuid(std::string uuid) {
  for (char& c : uuid) {
    if (c >= 'A' && c <= 'F') c = static_cast<char>(c - 'A' + 'a');
  }
  return uuid;
}

bool IsSha256Hex(std::string_view text) {
  return text.size() == kSha256HexLength && std::all_of(text.begin(), text.end(), IsLowerHex);
}

Status CheckReportText(std::string_view field, std::string_view text) {
  if (text.empty()) return InvalidArgument("{}: empty", field);
  if (text.size() > kMaxReportTextBytes) {
    return InvalidArgument(
        "{}: {} bytes, expected at most {}", field, text.size(), kMaxReportTextBytes);
  }
  return IsUtf8(text) ? OkStatus() : InvalidArgument("{}: is not UTF-8", field);
}

Status ValidateShiftReport(const ShiftReport& report) {
  SHIFTMAP_RETURN_IF_ERROR(CheckHead(report));
  SHIFTMAP_RETURN_IF_ERROR(CheckAll("evidence", report.evidence, report, CheckEvidence));
  SHIFTMAP_RETURN_IF_ERROR(CheckAll("decision", report.decisions, report, CheckDecision));
  SHIFTMAP_RETURN_IF_ERROR(CheckAll("sighting", report.sightings, report, CheckSighting));
  SHIFTMAP_RETURN_IF_ERROR(CheckAll("dropped", report.dropped, report, CheckDropped));
  const std::vector<std::size_t> repeated = Repetitions(report.evidence);
  if (repeated.empty()) return OkStatus();
  return InvalidArgument("evidence[{}]: another visit of '{}' at the same time",
                         repeated.front(),
                         report.evidence[repeated.front()].signature.text());
}

void LeaveOutInvalid(ShiftReport* report, std::size_t max_bytes) {
  EraseInvalid("invalid_evidence", CheckEvidence, &ShiftReport::evidence, report);
  EraseInvalid("invalid_decision", CheckDecision, &ShiftReport::decisions, report);
  EraseInvalid("invalid_sighting", CheckSighting, &ShiftReport::sightings, report);
  const std::vector<std::size_t> repeated = Repetitions(report->evidence);
  std::size_t i = 0;
  std::erase_if(report->evidence, [&](const VisitEvidence&) {
    return std::binary_search(repeated.begin(), repeated.end(), i++);
  });
  CountDropped("invalid_evidence", repeated.size(), report);

  // Texts of the head and reasons of what was dropped.
  const std::size_t head = (16 + report->dropped.size()) * (kMaxReportTextBytes + kFieldBytes);
  const std::size_t bytes =
      head + BytesOf(report->evidence) + BytesOf(report->decisions) + BytesOf(report->sightings);
  std::size_t excess = bytes > max_bytes ? bytes - max_bytes : 0;
  if (excess == 0) return;
  const auto sightings = [](const UnmappedSighting& sighting) { return sighting.count; };
  const auto alike = [](const Decision&) { return 0; };
  const auto observations = [](const VisitEvidence& visit) { return visit.observations; };
  EraseExcess("excess_sighting", sightings, &ShiftReport::sightings, &excess, report);
  EraseExcess("excess_decision", alike, &ShiftReport::decisions, &excess, report);
  EraseExcess("excess_evidence", observations, &ShiftReport::evidence, &excess, report);
}

}  // namespace shiftmap
