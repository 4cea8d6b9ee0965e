// SPDX-License-Identifier: Apache-2.0
#include "mapstore/codec/shift_report_check.h"

#include <algorithm>
#include <cmath>
#include <string_view>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr std::size_t kUuidLength = 36;
constexpr std::size_t kSha256HexLength = 64;

bool IsLowerHex(char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); }

bool IsUuid(std::string_view text) {
  if (text.size() != kUuidLength) return false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const bool dash = i == 8 || i == 13 || i == 18 || i == 23;
    if (dash ? text[i] != '-' : !IsLowerHex(text[i])) return false;
  }
  return true;
}

bool IsSha256Hex(std::string_view text) {
  return text.size() == kSha256HexLength && std::all_of(text.begin(), text.end(), IsLowerHex);
}

Status CheckText(std::string_view field, std::string_view text) {
  if (text.empty()) return InvalidArgument("{}: empty", field);
  if (text.size() > kMaxReportTextBytes) {
    return InvalidArgument(
        "{}: {} bytes, expected at most {}", field, text.size(), kMaxReportTextBytes);
  }
  return OkStatus();
}

Status CheckFinite(std::string_view field, double value) {
  if (std::isfinite(value)) return OkStatus();
  return InvalidArgument("{}: {}, expected a finite number", field, value);
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
  if (!IsUuid(report.uuid)) return InvalidArgument("uuid: not an RFC 4122 UUID in lower case");
  SHIFTMAP_RETURN_IF_ERROR(CheckText("vehicle", report.vehicle));
  SHIFTMAP_RETURN_IF_ERROR(CheckText("area", report.area));
  SHIFTMAP_RETURN_IF_ERROR(CheckText("software", report.software));
  if (report.version.value() < 1) {
    return InvalidArgument("version: {}, expected 1 or more", report.version.value());
  }
  if (!IsSha256Hex(report.content_hash)) {
    return InvalidArgument("content_hash: not a SHA-256 in lower-case hex");
  }
  if (!report.run_hash.empty() && !IsSha256Hex(report.run_hash)) {
    return InvalidArgument("run_hash: neither empty nor a SHA-256 in lower-case hex");
  }
  return CheckSpan("begin_ns, end_ns", report.begin, report.end, report);
}

Status CheckEvidence(const std::string& field,
                     const VisitEvidence& visit,
                     const ShiftReport& report) {
  SHIFTMAP_RETURN_IF_ERROR(CheckText(field + ".signature", visit.signature.text()));
  SHIFTMAP_RETURN_IF_ERROR(CheckSpan(field, visit.begin, visit.end, report));
  if (visit.observations < 0) {
    return InvalidArgument(
        "{}.observation_count: {}, expected 0 or more", field, visit.observations);
  }
  if (visit.modes.empty() || visit.modes.front().mode != kAbsent) {
    return InvalidArgument("{}.mode: does not begin with mode 0", field);
  }
  for (std::size_t i = 0; i < visit.modes.size(); ++i) {
    const std::string mode_field = fmt::format("{}.mode[{}]", field, i);
    if (i > 0 && visit.modes[i].mode <= visit.modes[i - 1].mode) {
      return InvalidArgument("{}.mode: {} after {}, expected ascending numbers",
                             mode_field,
                             visit.modes[i].mode.value(),
                             visit.modes[i - 1].mode.value());
    }
    SHIFTMAP_RETURN_IF_ERROR(
        CheckFinite(mode_field + ".log_likelihood", visit.modes[i].log_likelihood));
  }
  return OkStatus();
}

Status CheckDecision(const std::string& field,
                     const Decision& decision,
                     const ShiftReport& report) {
  SHIFTMAP_RETURN_IF_ERROR(CheckText(field + ".signature", decision.signature.text()));
  if (decision.mode < kAbsent) {
    return InvalidArgument("{}.mode: {}, expected 0 or more", field, decision.mode.value());
  }
  SHIFTMAP_RETURN_IF_ERROR(CheckFinite(field + ".log_odds", decision.log_odds));
  return CheckSpan(field + ".stamp_ns", decision.stamp, decision.stamp, report);
}

Status CheckSighting(const std::string& field,
                     const UnmappedSighting& sighting,
                     const ShiftReport& report) {
  if (!sighting.signature.anonymous()) {
    SHIFTMAP_RETURN_IF_ERROR(CheckText(field + ".signature", sighting.signature.text()));
  }
  SHIFTMAP_RETURN_IF_ERROR(CheckFinite(field + ".x_m", sighting.p_map_landmark.x()));
  SHIFTMAP_RETURN_IF_ERROR(CheckFinite(field + ".y_m", sighting.p_map_landmark.y()));
  if (!IsSymmetricPositiveDefinite(sighting.cov_p_map_landmark)) {
    return InvalidArgument("{}: covariance is not positive definite", field);
  }
  if (sighting.count < 1) {
    return InvalidArgument("{}.count: {}, expected 1 or more", field, sighting.count);
  }
  return CheckSpan(field, sighting.first, sighting.last, report);
}

Status CheckDropped(const std::string& field, const DroppedCount& dropped, const ShiftReport&) {
  SHIFTMAP_RETURN_IF_ERROR(CheckText(field + ".reason", dropped.reason));
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

}  // namespace

Status ValidateShiftReport(const ShiftReport& report) {
  SHIFTMAP_RETURN_IF_ERROR(CheckHead(report));
  SHIFTMAP_RETURN_IF_ERROR(CheckAll("evidence", report.evidence, report, CheckEvidence));
  SHIFTMAP_RETURN_IF_ERROR(CheckAll("decision", report.decisions, report, CheckDecision));
  SHIFTMAP_RETURN_IF_ERROR(CheckAll("sighting", report.sightings, report, CheckSighting));
  return CheckAll("dropped", report.dropped, report, CheckDropped);
}

}  // namespace shiftmap
