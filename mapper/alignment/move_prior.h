// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>

namespace shiftmap {

/// How landmarks move between two maps, before their positions are compared.
struct MovePrior {
  /// Probability that fewer than two of the landmarks in common stayed, which determine no
  /// transform. All larger numbers are equally likely.
  double none_stayed = 0.02;

  /// A landmark that moves goes near with this probability, else anywhere in the area.
  double near_share = 0.7;

  /// Sizes of near moves, equally likely, standard deviations per axis. The density of a near move
  /// u is |u|² N(u; s²I) / 2s², which vanishes at zero: a move by nothing is none. [m]
  std::array<double, 4> near_sd_m = {0.25, 0.5, 1.0, 2.0};

  /// Probability that some of the landmarks that moved did so together, as one rigid body; that a
  /// body which reaches over three landmarks or more reaches over one more; and that one within its
  /// reach goes along.
  double group_share = 0.03;
  double group_continue = 0.6;
  double group_along = 0.8;

  /// Of the scale of one map against the other. [-]
  double sd_scale = 0.02;
};

}  // namespace shiftmap
