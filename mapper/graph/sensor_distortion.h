// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "mapstore/run/run.h"

namespace shiftmap {

/// Systematic errors of a sensor beyond its SensorBias, smooth over the field of view: at range r
/// and bearing b it reads polynomials too much, in the range [m] and in the bearing [rad].
/// Cartesian observations have the same errors along the ray and across it.
struct SensorDistortion {
  /// Products of r and b: kRBB is r b².
  enum Monomial { kOne, kR, kB, kRR, kRB, kBB, kRBB, kMonomials };
  using Monomials = Eigen::Vector<double, kMonomials>;

  /// Of an observation, in metres and radians, in the order of Monomial.
  static Monomials MonomialsOf(const Observation& observation);

  /// By how much z changes with (range [m], bearing [rad]).
  static Eigen::Matrix2d DzDPolar(const Observation& observation);

  /// Rows: range, bearing; columns: Monomial.
  Eigen::Matrix<double, 2, kMonomials> coefficients = Eigen::Matrix<double, 2, kMonomials>::Zero();

  /// The observation as a sensor without distortion would have made it. No error is beyond half of
  /// the range and half a radian.
  Observation Undistorted(const Observation& observation) const;
};

}  // namespace shiftmap
