// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/circular_buffer.hpp>
#include <cstddef>
#include <optional>

#include "localizer/filter/odometry_buffer.h"
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
///
/// Memory: kept from call to call.
class PosePredictor {
 public:
  explicit PosePredictor(const OdometryCalibration& calibration)
      : calibration_(calibration), motion_(calibration) {}

  /// @param sample  Not older than the one before.
  void Add(const OdometrySample& sample);

  /// The localizer's pose after a scan.
  void Correct(const PoseEstimate& estimate);

  /// Whether odometry is trusted from now on; at first it is.
  void Trust(bool trusted) { motion_.Trust(trusted); }

  /// The pose at `now`, not before the last sample; nothing before the first Correct().
  std::optional<PoseEstimate> At(Stamp now);

 private:
  // Bounds what a long stretch without scans costs per step.
  static constexpr std::size_t kMaxSamples = 512;

  // Lets go of samples that nothing after the correction needs.
  void Trim();

  OdometryCalibration calibration_;
  // As far back as the motion since the correction needs.
  boost::circular_buffer<OdometrySample> samples_{kMaxSamples + 1};
  OdometryBuffer motion_;  // Since the correction; of no meaning between calls.
  std::optional<PoseEstimate> corrected_;
};

}  // namespace shiftmap::live
