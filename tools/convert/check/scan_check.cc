// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/check/scan_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace shiftmap {
namespace {

constexpr double kCircleRad = 2.0 * std::numbers::pi;

// No detector of coded landmarks sees as far, but every one as many millimetres.
constexpr double kFarM = 200.0;

// One landmark at two places of a scan, further apart than noise.
constexpr double kDoubleM = 0.5;

double HalfOf(std::int64_t count) { return 0.5 * static_cast<double>(count); }

}  // namespace

void ScanCheck::Add(const Scan& scan) {
  ++scans_;
  if (scan.observations.empty()) ++empty_scans_;
  for (const Observation& observation : scan.observations) {
    AddObservation(observation, scan.stamp);
  }
  FindDoubles(scan);
}

void ScanCheck::AddObservation(const Observation& observation, Stamp stamp) {
  ++observations_;
  if (!IsPlausible(observation, limits_)) {
    ++implausible_;
    if (!first_implausible_) first_implausible_ = stamp;
  }
  const bool polar = observation.kind == Observation::Kind::kRangeBearing;
  if (polar) {
    ++polar_;
    if (std::abs(observation.z.y()) > kCircleRad) ++beyond_circle_;
  }
  if ((polar ? observation.z.x() : observation.z.norm()) > kFarM) ++far_;
  const std::string& signature = observation.signature.text();
  if (signature.empty()) {
    ++anonymous_;
  } else if (counts_.size() < kMaxSignatures || counts_.count(signature) > 0) {
    ++counts_[signature];
  }
}

void ScanCheck::FindDoubles(const Scan& scan) {
  std::map<std::string, Eigen::Vector2d> seen;
  for (const Observation& observation : scan.observations) {
    const std::string& signature = observation.signature.text();
    if (signature.empty()) continue;
    const Eigen::Vector2d p = observation.PositionInVehicle();
    const auto [first, added] = seen.try_emplace(signature, p);
    if (added || (p - first->second).norm() < kDoubleM) continue;
    ++doubles_;
    if (!first_double_) first_double_ = scan.stamp;
    if (double_names_.size() < kMaxSignatures) double_names_.insert(signature);
  }
}

std::int64_t ScanCheck::seen_once() const {
  return std::count_if(
      counts_.begin(), counts_.end(), [](const auto& entry) { return entry.second == 1; });
}

void ScanCheck::Report(Stamp begin, Findings* findings) const {
  if (scans_ == 0) return;
  if (observations_ == 0) {
    findings->push_back({Severity::kError,
                         "no_observations",
                         "scans",
                         "no scan saw a landmark",
                         "see whether the detector knows the landmarks' codes"});
    return;
  }
  ReportSignatures(begin, findings);
  ReportUnits(findings);
  if (implausible_ > 0) {
    findings->push_back(
        {Severity::kWarning,
         "observation_limit",
         fmt::format("scans, {}", TimeInRun(*first_implausible_, begin)),
         fmt::format(
             "{} of {} observations are beyond {} m, or state noise that no sensor has, and "
             "are not used",
             implausible_,
             observations_,
             limits_.max_range_m),
         "leave out values that mean 'no reading'"});
  }
  if (empty_scans_ == 0) {
    findings->push_back({Severity::kNote,
                         "no_empty_scan",
                         "scans",
                         "every scan saw a landmark",
                         "log scans that saw nothing too: they tell that a landmark is gone"});
  }
}

void ScanCheck::ReportSignatures(Stamp begin, Findings* findings) const {
  if (doubles_ > 0) {
    findings->push_back({Severity::kWarning,
                         "signature_twice",
                         fmt::format("scans, {}", TimeInRun(*first_double_, begin)),
                         fmt::format("{} stand at two places in one scan; such sightings: {}",
                                     SomeNames({double_names_.begin(), double_names_.end()}),
                                     doubles_),
                         "give every landmark a code of its own; see whether codes are misread"});
  }
  if (counts_.size() == kMaxSignatures) {
    findings->push_back({Severity::kWarning,
                         "signatures_many",
                         "scans",
                         fmt::format("{} signatures or more", kMaxSignatures),
                         "a signature is the landmark's code, not the number of a detection"});
  }
  std::vector<std::string> once;
  for (const auto& [signature, count] : counts_) {
    if (count == 1) once.push_back(signature);
  }
  if (once.empty()) return;
  const bool most = static_cast<double>(once.size()) > HalfOf(signatures());
  findings->push_back({most ? Severity::kWarning : Severity::kNote,
                       "seen_once",
                       "scans",
                       fmt::format("{} of {} signatures are seen in one scan only: {}",
                                   once.size(),
                                   counts_.size(),
                                   SomeNames(once)),
                       "see whether codes are misread, or the signature is a counter"});
}

void ScanCheck::ReportUnits(Findings* findings) const {
  if (beyond_circle_ > 0) {
    findings->push_back({Severity::kWarning,
                         "bearing_degrees",
                         "scans",
                         fmt::format("{} of {} bearings are beyond a full circle, {:.3f} rad",
                                     beyond_circle_,
                                     polar_,
                                     kCircleRad),
                         "write bearings in radians"});
  }
  if (static_cast<double>(far_) > HalfOf(observations_)) {
    findings->push_back(
        {Severity::kWarning,
         "range_millimetres",
         "scans",
         fmt::format("{} of {} landmarks are more than {} m away", far_, observations_, kFarM),
         "write ranges in metres"});
  }
}

}  // namespace shiftmap
