// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "mapper/selection/selector.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The simulation of IJRR 8.1: a robot at the origin sees one landmark, which stands at each of
/// several places for some observations. What the paper does not print has its choice here.
struct IjrrSelectorsOptions {
  int runs = 100;  ///< Monte Carlo realizations per noise.
  std::uint64_t seed = 1;
  int threads = 1;  ///< Realizations side by side; the result does not depend on it.

  /// r of R = r I, the covariance of an observation. [m²]
  std::vector<double> noises_m2 = {0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.75, 1.0};

  /// Where the landmark stands, in this order; the paper draws three places without coordinates.
  /// [m]
  std::vector<Eigen::Vector2d> places = {{1.0, 1.0}, {2.2, 1.0}, {1.6, 2.04}};
  int observations_per_place = 10;

  /// Per observation. The paper prints none for this simulation; 1e-4 is that of IJRR 8.2.2, and at
  /// 0.1, that of 8.2.4, its figure 6 comes out. In (0, 1).
  double change_probability = 1e-4;
  double detection_probability = 0.6;  ///< IJRR 8.2.2. The same for all modes, so without effect.
  bool known_start = false;            ///< Pr(δ_1) is one for the first place instead of uniform.

  /// Of the robot per observation, IJRR 8.1: Q = diag(0.01², 0.01², 0.001²). [m, m, rad]
  Eigen::Vector3d process_sd = {0.01, 0.01, 0.001};
  double prior_sd_m = 0.1;    ///< Of each coordinate of a mode in the map that SLAM starts from.
  int max_alternations = 10;  ///< Of selection and solving, IJRR 8.2.2.
  MctsOptions mcts;           ///< But for the roll-out, of which there is either.

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// A selector as the experiment runs it.
struct NamedSelector {
  std::string name;
  SelectorOptions options;
};

/// All selectors, and mcts with either roll-out.
std::vector<NamedSelector> IjrrSelectors(const IjrrSelectorsOptions& options);

/// How one selector does at one noise, means over all realizations.
struct IjrrSelectorsRow {
  double noise_m2 = 0.0;
  std::string selector;

  // The selector by itself, the places known (IJRR figure 6).
  double wrong_ratio = 0.0;     ///< Of the observations, given the wrong mode.
  double wrong_ratio_se = 0.0;  ///< Its standard error.
  double optimal_ratio = 0.0;   ///< Of the realizations, with a sequence as likely as the best.
  double joint_deficit = 0.0;   ///< log p(best) - log p(selected), IJRR (19).
  double select_us = 0.0;       ///< Processor time of a selection, of its first thread. [µs]

  // In a SLAM solver (IJRR figure 7).
  double slam_rmse_m = 0.0;  ///< Of the last robot position and the last mode's, combined. [m]
  double slam_wrong_ratio = 0.0;
  double slam_wrong_ratio_se = 0.0;
  double slam_alternations = 0.0;
};

/// One realization: what is seen of a landmark.
struct IjrrRealization {
  std::vector<int> truth;                     ///< Index of the place, per observation.
  std::vector<Eigen::Vector2d> observations;  ///< In the vehicle frame. [m]
};

/// The observations of IJRR figure 5, the robot at the origin throughout.
IjrrRealization SimulateIjrr(const IjrrSelectorsOptions& options, double noise_m2, int run);

/// The chain of a realization whose places are known: a step per observation, with the options'
/// start and transition.
ModeSequenceProblem MakeIjrrSequence(const IjrrSelectorsOptions& options,
                                     double noise_m2,
                                     const IjrrRealization& realization);

/// Rows by noise, then selector in the order of IjrrSelectors(). Determinism: the same options give
/// the same rows but for the times. Errors: as Validate().
StatusOr<std::vector<IjrrSelectorsRow>> RunIjrrSelectors(
    const IjrrSelectorsOptions& options, const std::function<void(double done)>& progress);

}  // namespace shiftmap
