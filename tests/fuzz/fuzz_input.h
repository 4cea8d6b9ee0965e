// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "mapstore/core/stamp.h"

namespace shiftmap::testing {

/// Takes values off the front of a fuzzer's input; zeros after its end.
class FuzzInput {
 public:
  explicit FuzzInput(std::string_view bytes) : rest_(bytes) {}

  bool empty() const { return rest_.empty(); }
  std::string_view rest() const { return rest_; }

  /// A big-endian number of up to 8 bytes.
  std::uint64_t Take(int bytes);

  /// A number below `count` > 0, from one byte or two.
  std::size_t Index(std::size_t count);

  std::string_view TakeBytes(std::size_t count);

  /// Up to 31 bytes.
  std::string Text() { return std::string(TakeBytes(Take(1) % 32)); }

  /// A double: one of kExtremes, one of everyday size, or any bits.
  double Number();

  /// Adds up to 146 years, forwards or backwards, to a stamp; stops at the ends of the type.
  Stamp Moved(Stamp stamp);

 private:
  std::string_view rest_;
};

/// The input of FuzzInput::Number() for kExtremes[i].
std::string ExtremeNumber(std::size_t i);

/// Numbers at which something changes: limits of validation, of types and of devices.
inline constexpr double kExtremes[] = {
    0.0,  -0.0,  1.0,    -1.0,   1e-9,   -1e-9,   1e-6,   0.05,  3.1416,       -3.1416, 6.2832,
    50.0, 100.0, -100.0, 999.99, 1000.0, 1e5,     -1e5,   9.9e8, 1e9,          -1e9,    1.1e9,
    1e18, 1e-18, 5e-324, 1e300,  -1e300, 1.7e308, 1e-300, 1e12,  2147483648.0, 9.3e18};

}  // namespace shiftmap::testing
