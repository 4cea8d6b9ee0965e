// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <random>

namespace shiftmap {

/// Noise of unit variance on standardized residuals: a random sign each, a bit of the generator
/// (Hutchinson: A stochastic estimator of the trace of the influence matrix, 1990).
class RandomSigns {
 public:
  explicit RandomSigns(std::mt19937_64* random) : random_(*random) {}

  /// @param columns  Of the matrix, whose rows stay as many.
  template <typename Matrix>
  void Fill(Eigen::Index columns, Matrix* matrix) {
    matrix->resize(matrix->rows(), columns);
    for (double& value : matrix->reshaped()) value = Next();
  }

 private:
  double Next() {
    if (left_ == 0) {
      bits_ = random_();
      left_ = 64;
    }
    const double sign = (bits_ & 1) != 0 ? 1.0 : -1.0;
    bits_ >>= 1;
    --left_;
    return sign;
  }

  std::mt19937_64& random_;
  std::uint64_t bits_ = 0;
  int left_ = 0;
};

}  // namespace shiftmap
