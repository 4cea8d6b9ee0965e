// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/circular_buffer.hpp>
#include <cstddef>
#include <optional>

#include "localizer/models/motion_model.h"

namespace shiftmap {

/// Turns a live stream of odometry into the motion between scans.
///
/// The velocity that holds at time t is that of the newest sample at or before t - lag. A sample
/// holds for a second at most: in a longer gap the vehicle counts as anywhere that it could have
/// got to. It is thought to stand, with a standard deviation of its speed, the same until landmarks
/// determine the pose, and a random walk of its heading. That speed is the fastest that odometry
/// has said, 1 m/s at least, and 2 m/s if it has said nothing. Odometry that is not trusted has the
/// same noise, with the speed that it says, 1 m/s at least: the fastest may be as wrong.
///
/// Memory: room for 256 samples, made at once; for more if the lag asks for it or before a Take().
class OdometryBuffer {
 public:
  explicit OdometryBuffer(const OdometryCalibration& calibration) : calibration_(calibration) {}

  /// @param sample  Not older than the one before.
  void Add(const OdometrySample& sample);

  /// The motion since the last call, or nothing (identity) on the first one. What is still to come
  /// of odometry must not be older than `end`.
  /// @param end  Not before that of the last call.
  struct Motion {
    MotionIncrement increment;
    double elapsed_s = 0.0;
    double silent_s = 0.0;  ///< At `end`: since the last sample ceased to hold; 0 if one holds. [s]

    /// At `end`: since odometry was trusted, or PoseDetermined() if that is later. [s]
    double unknown_s = 0.0;
  };
  Motion Take(Stamp end);

  /// Landmarks determined the pose at the end of the last Take(): a way that is not known begins
  /// there.
  void PoseDetermined() { pending_.unknown_s = 0.0; }

  /// Whether odometry is trusted from the end of the last Take() on; at first it is.
  void Trust(bool trusted) { trusted_ = trusted; }

  /// How long after the last sample a heading that was exact is uncertain by `sd_rad`.
  static Duration SilenceUntil(double sd_rad);

  /// Forgets what was added and taken; the memory stays.
  void Restart();

 private:
  static constexpr std::size_t kSamples = 256;

  // Standard deviations of the speed of a vehicle whose odometry has said nothing, and of one that
  // was slow so far. [m/s]
  static constexpr double kUnknownSpeed = 2.0;
  static constexpr double kLeastTopSpeed = 1.0;

  // Integrates pending_ up to `end` and lets go of samples that nothing needs any more.
  void AdvanceTo(Stamp end);

  OdometryCalibration calibration_;
  boost::circular_buffer<OdometrySample> samples_{kSamples + 1};
  bool started_ = false;
  Stamp now_;                          // Up to where pending_ reaches.
  Motion pending_;                     // Its silent_s and unknown_s are those at now_.
  std::optional<double> fastest_mps_;  // That odometry has said, kLeastTopSpeed at least.
  bool trusted_ = true;
};

}  // namespace shiftmap
