// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cstdint>
#include <random>

namespace shiftmap {

/// Everything random of a simulation, from one generator in a fixed order.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : random_(seed) {}

  /// In [low, high).
  double Uniform(double low, double high) { return low + (high - low) * uniform_(random_); }
  bool Coin(double probability) { return uniform_(random_) < probability; }
  double Normal() { return normal_(random_); }
  int Poisson(double mean) { return std::poisson_distribution<int>(mean)(random_); }
  Eigen::Vector2d Normal2() {
    const double x = Normal();
    return {x, Normal()};
  }
  /// N(0, cov).
  Eigen::Vector3d Normal3(const Eigen::Matrix3d& cov) {
    const Eigen::Vector2d xy = Normal2();
    return Eigen::Matrix3d(cov.llt().matrixL()) * Eigen::Vector3d(xy.x(), xy.y(), Normal());
  }
  /// Draws an index with its probability.
  int Index(const Eigen::VectorXd& probabilities) {
    double left = uniform_(random_);
    for (int i = 0; i + 1 < probabilities.size(); ++i) {
      left -= probabilities[i];
      if (left < 0.0) return i;
    }
    return static_cast<int>(probabilities.size()) - 1;
  }

 private:
  std::mt19937_64 random_;
  std::uniform_real_distribution<double> uniform_;
  std::normal_distribution<double> normal_;
};

}  // namespace shiftmap
