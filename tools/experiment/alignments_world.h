// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "mapper/alignment/alignment_evidence.h"
#include "mapper/alignment/consensus.h"
#include "mapstore/geometry/se2.h"

namespace shiftmap {

/// How the landmarks of a simulated site moved between two maps of it.
enum class AlignmentWorld {
  kPrior,         ///< As MovePrior has it.
  kSpread,        ///< Those that stayed are anywhere.
  kCorner,        ///< 2 to 6 stayed, those nearest to a corner.
  kSymmetric,     ///< A grid or two equal rows; of those that moved half went to others' places.
  kSwappedRacks,  ///< Two racks changed places.
  kRackMoved,     ///< One rack is elsewhere.
  kNone,          ///< Nothing stayed.
  kReturns,       ///< The reference has up to four modes of a landmark; half go to one of them.
};

inline constexpr std::size_t kAlignmentWorlds = 8;

/// In options and tables, e.g. "rack-moved".
const char* ToString(AlignmentWorld world);

/// Two maps of one site, with what they do not tell.
struct AlignmentPair {
  JointPoints reference;
  JointPoints other;
  double area_m2 = 0.0;   ///< As the methods are told it. [m²]
  double sd_scale = 0.0;  ///< Of the scale between the maps beyond their covariances. [-]

  /// Of the points of the reference, without error: first the last place of each landmark. [m]
  std::vector<Eigen::Vector2d> places;

  int stayed = 0;         ///< Landmarks, at any of their places.
  Se2 T_other_reference;  ///< Rotation, and where the origin goes.
  double scale = 1.0;     ///< Of the other map against the reference. [-]

  /// Whether a frame puts every landmark within `tolerance_m` of its place, but for the scale,
  /// which no rigid transform has: that is taken out about the centre of the frame.
  bool IsRight(const Alignment& alignment, double tolerance_m) const;
};

/// Draws a pair: a square of 8 to 20 m with 5 to 40 landmarks (`kPrior`: 5 to 14). Of a landmark
/// that moved the length of the move is Rayleigh with a scale of 0.2 to 2 m, or it is anywhere,
/// half each; 10 to 100 % moved where the world does not say otherwise. A rack is 3 to 6 landmarks
/// within 1.5 m; there are four landmarks or more beside racks, 0 to 100 % of which moved. Racks
/// that change places are turned by a half or not.
///
/// The errors of each map are drawn from the covariance that the methods are given: a path across
/// the site bends at eight places, by up to 0.03 rad in all (sd), the scale has sd 1 % and each
/// landmark an error of its own of 2 to 6 cm, all relative to the positions as a whole.
/// Determinism: the same seed gives the same pair.
AlignmentPair DrawAlignmentPair(AlignmentWorld world, std::uint64_t seed);

}  // namespace shiftmap
