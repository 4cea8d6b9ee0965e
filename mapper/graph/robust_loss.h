// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace shiftmap {

/// Cauchy's loss of an observation, a whitened residual r of two rows,
///
///   ρ(‖r‖²) = κ c² log(1 + u),   u = ‖r‖²/c²
///
/// Its weights as iteratively reweighted least squares has them, and its curvature, the mean over
/// directions of the Hessian of ρ/2, are
///
///   ρ' = κ / (1 + u),   κ / (1 + u)²
///
/// κ is such that over Gaussian residuals the mean curvature is the variance of the slope ψ = ρ' r,
/// as it is for a log-likelihood (Bartlett's identity): the inverse Hessian is then the covariance
/// of the fit, and what is lost to the loss, 5 % of an observation, is not taken for noise of the
/// odometry or for the lack of it. With F_k the mean of (1 + u)⁻ᵏ,
///
///   κ = F₂ / (a (F₁ - F₂)),   F₂ = a eᵃ E₂(a) = a (1 - F₁),   a = c²/2
///
/// and E₂ an exponential integral.
///
/// Beyond a reach the loss is constant. Its slope goes down with 1 / ‖r‖ only, and outliers may all
/// pull alike: a landmark that is read where it is not is farther away than it seems, and that
/// every one of them says to the scale of the map, κ c² in all for each however far it is.
class RobustLoss {
 public:
  /// @param scale  c > 0, in standard deviations.
  /// @param reach  Largest ‖r‖ that pulls, in standard deviations.
  /// @param variance_factor  By which all of the loss is divided (GraphRun::variance_factor).
  explicit RobustLoss(double scale,
                      double reach = std::numeric_limits<double>::infinity(),
                      double variance_factor = 1.0)
      : squared_scale_(scale * scale),
        squared_reach_(reach * reach),
        kappa_(Kappa(scale) / variance_factor) {}

  /// ρ/2, and below. @param squared  ‖r‖².
  double HalfLoss(double squared) const {
    const double u = std::min(squared, squared_reach_) / squared_scale_;
    return 0.5 * kappa_ * squared_scale_ * std::log1p(u);
  }

  /// ρ', of the slope ρ' r.
  double Slope(double squared) const { return squared <= squared_reach_ ? Weight(squared) : 0.0; }

  /// The same as a matrix has it, and below: beyond the reach what would be without. With none at
  /// all, what only far outliers tell is not determined.
  double Weight(double squared) const { return kappa_ / (1.0 + squared / squared_scale_); }

  /// Of far outliers more than there is.
  double Curvature(double squared) const {
    constexpr double kLeast = 0.1;
    return Weight(squared) * std::max(kLeast, 1.0 / (1.0 + squared / squared_scale_));
  }

  /// For steps near a minimum. The weights majorize the loss, so that steps by them go down, and so
  /// do those less than twice as long: with more than half of the weight.
  double StepCurvature(double squared) const {
    constexpr double kLeast = 0.6;
    return Weight(squared) * std::max(kLeast, 1.0 / (1.0 + squared / squared_scale_));
  }

 private:
  // eᵃ E₂(a) is a continued fraction (Abramowitz, Stegun 5.1.22), here from its end.
  static double Kappa(double scale) {
    constexpr int kTerms = 200;
    const double a = 0.5 * scale * scale;
    double fraction = a + 2.0 * kTerms;
    for (int k = kTerms - 1; k > 0; --k) fraction = a + 2.0 * k - k * (k + 1.0) / fraction;
    const double F_2 = a / fraction;
    return F_2 / (a * (1.0 - F_2 - F_2 / a));
  }

  double squared_scale_;
  double squared_reach_;
  double kappa_;
};

}  // namespace shiftmap
