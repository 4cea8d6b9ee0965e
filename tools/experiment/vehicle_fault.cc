// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/vehicle_fault.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <set>
#include <utility>

#include "mapstore/codec/shift_report.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap {
namespace {

// Reports that a flood makes of one.
constexpr int kFloodReports = 40;

// Neighbours by name take each other's.
Run MisreadCodes(Run log) {
  std::set<Signature> signatures;
  for (const Scan& scan : log.scans) {
    for (const Observation& of : scan.observations) {
      if (!of.signature.anonymous()) signatures.insert(of.signature);
    }
  }
  std::map<Signature, Signature> read_as;
  for (auto first = signatures.begin(); first != signatures.end();) {
    const auto second = std::next(first);
    if (second == signatures.end()) break;
    read_as.emplace(*first, *second);
    read_as.emplace(*second, *first);
    first = std::next(second);
  }
  for (Scan& scan : log.scans) {
    for (Observation& of : scan.observations) {
      if (const auto found = read_as.find(of.signature); found != read_as.end()) {
        of.signature = found->second;
      }
    }
  }
  return log;
}

// For the state after the one that the visit favours, as firmly as a visit may be.
void Falsify(VisitEvidence* visit) {
  const auto more_likely = [](const auto& a, const auto& b) {
    return a.log_likelihood < b.log_likelihood;
  };
  auto claimed = std::max_element(visit->modes.begin(), visit->modes.end(), more_likely);
  if (++claimed == visit->modes.end()) claimed = visit->modes.begin();
  for (auto& mode : visit->modes) mode.log_likelihood = -kMaxVisitLogRatio;
  claimed->log_likelihood = 0.0;
}

// The part of a report that a shift from `begin` to `end` would have made, as a run of its own.
ShiftReport PartOf(const ShiftReport& report, Stamp begin, Stamp end) {
  ShiftReport part = report;
  part.uuid = RandomUuid();
  part.run_uuid = part.uuid;
  part.run_hash.clear();
  part.begin = begin;
  part.end = end;
  for (VisitEvidence& visit : part.evidence) {
    visit.begin = begin;
    visit.end = end;
  }
  // A landmark that was visited twice.
  std::set<Signature> claimed;
  std::erase_if(part.evidence,
                [&](const VisitEvidence& of) { return !claimed.insert(of.signature).second; });
  return part;
}

}  // namespace

std::vector<VehicleFault> AllVehicleFaults() {
  return {VehicleFault::kNone,
          VehicleFault::kMisreadCodes,
          VehicleFault::kFrozenOdometer,
          VehicleFault::kReversedOdometer,
          VehicleFault::kFalseReports,
          VehicleFault::kFlood};
}

std::string FaultName(VehicleFault fault) {
  switch (fault) {
    case VehicleFault::kNone:
      return "none";
    case VehicleFault::kMisreadCodes:
      return "misread codes";
    case VehicleFault::kFrozenOdometer:
      return "frozen odometer";
    case VehicleFault::kReversedOdometer:
      return "reversed odometer";
    case VehicleFault::kFalseReports:
      return "false reports";
    case VehicleFault::kFlood:
      return "flood";
  }
  return "";
}

bool IsOfReports(VehicleFault fault) {
  return fault == VehicleFault::kFalseReports || fault == VehicleFault::kFlood;
}

Run WithFault(Run log, VehicleFault fault) {
  if (fault == VehicleFault::kMisreadCodes) return MisreadCodes(std::move(log));
  for (OdometrySample& sample : log.odometry) {
    if (fault == VehicleFault::kFrozenOdometer) sample.v_mps = sample.omega_radps = 0.0;
    if (fault == VehicleFault::kReversedOdometer) sample.v_mps = -sample.v_mps;
  }
  return log;
}

std::vector<ShiftReport> WithFault(const ShiftReport& report, VehicleFault fault) {
  if (!IsOfReports(fault)) return {report};
  ShiftReport falsified = report;
  falsified.decisions.clear();
  falsified.sightings.clear();
  for (VisitEvidence& visit : falsified.evidence) Falsify(&visit);
  if (fault == VehicleFault::kFalseReports) return {falsified};
  std::vector<ShiftReport> flood;
  const Duration step = (report.end - report.begin) / kFloodReports;
  for (int i = 0; i < kFloodReports; ++i) {
    const Stamp begin = report.begin + i * step;
    flood.push_back(PartOf(falsified, begin, begin + step));
  }
  return flood;
}

}  // namespace shiftmap
