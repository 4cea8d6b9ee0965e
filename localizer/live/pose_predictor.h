// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <optional>

#include "localizer/localizer.h"
#include "mapstore/map/calibration.h"
#include "mapstore/run/run.h"

namespace shiftmap::live {

/// The pose between scans: the last one that the localizer made, moved on by the odometry since.
///
///   T ← T · ΔT,  P ← Ad(ΔT⁻¹) P Ad(ΔT⁻¹)ᵀ + Q
///
/// It holds for the odometry's last stamp. The vehicle's own deviation from the fleet's calibration
/// is not applied here; over the fraction of a second between scans it is inside Q.
class PosePredictor {
 public:
  explicit PosePredictor(const OdometryCalibration& calibration) : calibration_(calibration) {}

  /// @param sample  Not older than the one before.
  void Add(const OdometrySample& sample);

  /// The localizer's pose after a scan.
  void Correct(const PoseEstimate& estimate);

  /// The pose at `now`, not before the last sample; nothing before the first Correct().
  std::optional<PoseEstimate> At(Stamp now) const;

 private:
  // Lets go of samples that nothing after the correction needs.
  void Trim();

  OdometryCalibration calibration_;
  std::deque<OdometrySample> samples_;  // As far back as the motion since the correction needs.
  std::optional<PoseEstimate> corrected_;
};

}  // namespace shiftmap::live
