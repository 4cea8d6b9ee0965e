// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/geometry/se2.h"
#include "mapstore/run/run.h"
#include "tools/convert/check/finding.h"

namespace shiftmap {

/// Whether landmarks move through the vehicle's view as its odometry says they must.
///
/// Two sightings p1, p2 of a landmark, one to ten seconds apart, are a pair. With the motion T of
/// the vehicle between them by odometry, a landmark that stands gives p2 = T⁻¹ p1. The misfit of a
/// pair is
///
///     |(p2 - p1) - (T⁻¹ p1 - p1)| / (|p2 - p1| + |T⁻¹ p1 - p1|),
///
/// 0 for a perfect fit, 1 where the landmark moves the wrong way. Each mistake that loggers make
/// (a sign, a unit, a sensor that looks backwards) is an alternative: the same pairs with the
/// mistake undone. An alternative holds if it fits better in at least four of five pairs that it
/// changes, twenty pairs at least, and fits them well, and most of all pairs. Landmarks that were
/// moved, misread codes and noise are few of the pairs and change nothing.
///
/// A mirrored sensor and a yaw rate of the wrong sign give the same pairs, as do a reversed sensor
/// and a speed of the wrong sign.
class MotionCheck {
 public:
  MotionCheck();

  /// Items in the order of time; others are skipped.
  void Add(const OdometrySample& sample);
  void Add(const Scan& scan);

  void Report(Findings* findings) const;

  std::int64_t pairs() const { return pairs_; }

  /// Median misfit as logged; nothing without pairs.
  std::optional<double> MedianMisfit() const;

  /// What is tried in place of the log's numbers.
  static constexpr std::size_t kAlternatives = 17;

 private:
  /// Odometry with a unit undone.
  static constexpr std::size_t kOdometries = 7;
  using Poses = std::array<Se2, kOdometries>;

  struct Anchor {
    Stamp stamp;
    Observation observation;
    Poses T_begin_vehicle;
  };
  /// Pairs that an alternative changes.
  struct Tally {
    std::int64_t fitting = 0;  // Of all pairs.
    std::int64_t changed = 0;
    std::int64_t better = 0;
    std::vector<float> misfits;
  };

  void MoveTo(Stamp stamp);
  void AddPair(const Anchor& first, const Observation& second);
  bool Holds(const Tally& tally) const;
  bool ReportFrozen(Findings* findings) const;  // Whether it is.

  std::optional<OdometrySample> odometry_;
  bool turns_ = false;  // Whether a yaw rate was logged that is not 0.
  Stamp at_;
  Poses T_begin_vehicle_;
  std::map<std::string, Anchor> anchors_;

  std::int64_t pairs_ = 0;
  std::int64_t odometry_still_ = 0;  // Pairs in which the landmark moves and the odometry not,
  std::int64_t landmark_still_ = 0;  // and the other way round.
  std::int64_t turning_ = 0;         // Pairs that tell left from right.
  std::vector<float> misfits_;       // As logged.
  std::array<Tally, kAlternatives> tallies_;
};

}  // namespace shiftmap
