// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/position_region.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <boost/math/quadrature/gauss.hpp>
#include <cmath>
#include <numbers>

namespace shiftmap {
namespace {

constexpr double kTailSds = 7.0;  // Beyond them is less than 1e-11.
constexpr int kPanels = 4;  // Where the range's edge cuts a long ellipse, the density has a step.
constexpr double kMinSdM = 1e-9;
constexpr double kToleranceM = 1e-6;
constexpr double kTolerance = 1e-5;

double NormalTail(double z) { return 0.5 * std::erfc(z / std::numbers::sqrt2); }

// @param m  Mean in the axes of the covariance, from the center. @param s  Standard deviations.
double Within(const Eigen::Vector2d& m, const Eigen::Vector2d& s, double radius) {
  const double low = std::clamp((m.x() - kTailSds * s.x()) / radius, -1.0, 1.0);
  const double high = std::clamp((m.x() + kTailSds * s.x()) / radius, -1.0, 1.0);
  if (low >= high) return 0.0;
  const auto density = [&](double angle) {
    const double x = radius * std::sin(angle);
    const double h = radius * std::cos(angle);
    const double z = (x - m.x()) / s.x();
    const double inside = NormalTail((-h - m.y()) / s.y()) - NormalTail((h - m.y()) / s.y());
    return std::exp(-0.5 * z * z) / (s.x() * std::sqrt(2.0 * std::numbers::pi)) * inside * h;
  };
  using Quadrature = boost::math::quadrature::gauss<double, 30>;
  const double begin = std::asin(low);
  const double step = (std::asin(high) - begin) / kPanels;
  double sum = 0.0;
  for (int i = 0; i < kPanels; ++i) {
    sum += Quadrature::integrate(density, begin + i * step, begin + (i + 1) * step);
  }
  return sum;
}

// In the axes of its covariance: the shorter one first, in which the density is integrated.
struct Component {
  double weight = 0.0;
  Eigen::Vector2d m;
  Eigen::Vector2d s;
};

Component InItsAxes(const WeightedPosition& position, const Eigen::Vector2d& center) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(position.cov);
  return {position.weight,
          solver.eigenvectors().transpose() * (position.p - center),
          solver.eigenvalues().cwiseMax(kMinSdM * kMinSdM).cwiseSqrt()};
}

}  // namespace

double ProbabilityWithin(std::span<const WeightedPosition> mixture,
                         const Eigen::Vector2d& center,
                         double radius_m) {
  double probability = 0.0;
  double weights = 0.0;
  for (const WeightedPosition& position : mixture) {
    const Component component = InItsAxes(position, center);
    probability += component.weight * Within(component.m, component.s, radius_m);
    weights += component.weight;
  }
  return std::min(probability / weights, 1.0);
}

double RadiusHolding(double probability,
                     std::span<const WeightedPosition> mixture,
                     const Eigen::Vector2d& center) {
  double low = 0.0;
  double high = 0.0;
  for (const WeightedPosition& position : mixture) {
    const Component component = InItsAxes(position, center);
    high = std::max(high, component.m.norm() + kTailSds * component.s.y());
  }
  while (high - low > std::max(kToleranceM, kTolerance * low)) {
    const double middle = 0.5 * (low + high);
    (ProbabilityWithin(mixture, center, middle) < probability ? low : high) = middle;
  }
  return high;
}

}  // namespace shiftmap
