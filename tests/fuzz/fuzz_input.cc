// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/fuzz_input.h"

#include <algorithm>
#include <bit>
#include <iterator>
#include <limits>

namespace shiftmap::testing {
namespace {

// The first byte of a number that is one of kExtremes; below are those of everyday size.
constexpr std::uint64_t kFirstExtreme = 128;
constexpr std::uint64_t kFirstBits = 240;

}  // namespace

std::uint64_t FuzzInput::Take(int bytes) {
  std::uint64_t value = 0;
  for (int i = 0; i < bytes && !rest_.empty(); ++i) {
    value = value << 8U | static_cast<unsigned char>(rest_.front());
    rest_.remove_prefix(1);
  }
  return value;
}

std::size_t FuzzInput::Index(std::size_t count) {
  constexpr std::size_t kOneByte = 256;
  return Take(count <= kOneByte ? 1 : 2) % count;
}

std::string_view FuzzInput::TakeBytes(std::size_t count) {
  const std::string_view taken = rest_.substr(0, count);
  rest_.remove_prefix(taken.size());
  return taken;
}

double FuzzInput::Number() {
  const std::uint64_t kind = Take(1);
  if (kind >= kFirstBits) return std::bit_cast<double>(Take(8));
  if (kind >= kFirstExtreme) return kExtremes[(kind - kFirstExtreme) % std::size(kExtremes)];
  return (static_cast<double>(kind << 8U | Take(1)) - 16384.0) / 1024.0;
}

Stamp FuzzInput::Moved(Stamp stamp) {
  constexpr Duration kUnits[] = {std::chrono::nanoseconds(1),
                                 std::chrono::milliseconds(1),
                                 std::chrono::seconds(1),
                                 std::chrono::hours(1),
                                 std::chrono::hours(1000)};
  const Duration unit = kUnits[Index(std::size(kUnits))];
  const auto count = static_cast<std::int16_t>(Take(2));
  std::int64_t step = 0;
  std::int64_t sum = 0;
  if (__builtin_mul_overflow(unit.count(), count, &step) ||
      __builtin_add_overflow(ToNanoseconds(stamp), step, &sum)) {
    return count < 0 ? Stamp::min() : Stamp::max();
  }
  return StampFromNanoseconds(sum);
}

std::string ExtremeNumber(std::size_t i) {
  return std::string(1, static_cast<char>(kFirstExtreme + i % std::size(kExtremes)));
}

}  // namespace shiftmap::testing
