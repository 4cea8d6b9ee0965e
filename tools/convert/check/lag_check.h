// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>

#include "mapstore/geometry/se2.h"
#include "mapstore/run/run.h"
#include "tools/convert/check/finding.h"

namespace shiftmap {

/// How far the clocks of odometry and scans are apart.
///
/// Two sightings p1, p2 of a landmark, one to three seconds apart, are a pair. With the motion T
/// between them by the odometry that is stamped a lag earlier, a landmark that stands gives
/// p2 = T⁻¹ p1. The lag of a grid over which the mean misfit of all pairs (MotionCheck) is least is
/// the estimate, refined by a parabola. It is reported if the pairs fit better with it than with
/// none by five standard errors. A vehicle that neither turns nor changes its speed shows no lag.
///
/// Memory: the odometry of some ten seconds, and one sighting a signature.
class LagCheck {
 public:
  /// Items in the order of time; others are skipped.
  void Add(const OdometrySample& sample);
  void Add(const Scan& scan);

  /// By how much scans are stamped later than the odometry of the same moment; nothing if the pairs
  /// do not show it. [s]
  std::optional<double> Lag() const;

  /// What Lag() is worth a warning, or a note, if it is.
  void Report(Findings* findings) const;

 private:
  static constexpr int kSteps = 25;  // To each side of none.
  static constexpr std::size_t kLags = 2 * kSteps + 1;

  struct Sample {
    OdometrySample odometry;
    Se2 T_begin_vehicle;
  };
  struct Sighting {
    Stamp stamp;
    Eigen::Vector2d position;
  };
  struct Pair {
    Sighting first;
    Sighting second;
  };

  std::optional<Se2> PoseAt(Stamp stamp) const;
  void Score(const Pair& pair);
  void ScoreDue(Stamp newest);

  std::deque<Sample> samples_;
  std::map<std::string, Sighting> anchors_;
  std::deque<Pair> pending_;  // Whose odometry is still to come.

  std::int64_t pairs_ = 0;
  std::array<double, kLags> misfit_{};        // Σ misfit
  std::array<double, kLags> squared_gain_{};  // Σ (misfit without a lag - misfit)²
};

}  // namespace shiftmap
