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

  /// Rigid bodies, racks for instance, that are expected at a site; each takes in three landmarks,
  /// and one more with this probability, again and again. They stand as a Gaussian of one of these
  /// sizes, equally likely, standard deviations per axis [m], or, this share of them, anywhere:
  /// barriers for instance that are displaced together, and not turned.
  double group_share = 0.03;
  double group_continue = 0.6;
  std::array<double, 3> body_sd_m = {0.25, 0.5, 1.0};
  double scattered_share = 0.1;

  /// Probability that a body falls apart: that its landmarks stay or move each by itself.
  double body_apart = 0.1;

  /// Probability that of two bodies that moved each is where the other was.
  double exchange_share = 0.5;

  /// Bodies that move go on facing the same way, up to this, in half of all cases, scattered ones
  /// in all. Standard deviation. [rad]
  double same_heading_sd_rad = 0.2;

  /// Standard deviations of how far the landmarks of a body that takes the place of another are
  /// from those that stood there, and of how well each of two takes the place of the other.
  double slot_sd_m = 0.5;
  double exchange_sd_m = 0.1;
  double exchange_heading_sd_rad = 0.05;

  /// Of the scale of one map against the other. [-]
  double sd_scale = 0.02;
};

}  // namespace shiftmap
