// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

namespace shiftmap {

/// The logarithm of a product of many numbers in (0, 1], with few logarithms and no underflow.
class LogProduct {
 public:
  void Multiply(double factor) {
    constexpr double kSmall = 1e-150;
    if (product_ < kSmall || factor < kSmall) {
      log_ += std::log(product_);
      product_ = 1.0;
    }
    product_ *= factor;
  }

  double Log() const { return log_ + std::log(product_); }

 private:
  double product_ = 1.0;
  double log_ = 0.0;  // Of the factors before those of the product.
};

}  // namespace shiftmap
