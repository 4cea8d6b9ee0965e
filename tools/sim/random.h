// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <random>

namespace shiftmap {

using Random = std::mt19937_64;

/// Streams of random numbers that do not depend on how much another one drew.
inline Random MakeRandom(std::uint64_t seed, int stream) {
  std::seed_seq sequence{static_cast<std::uint32_t>(seed),
                         static_cast<std::uint32_t>(seed >> 32),
                         static_cast<std::uint32_t>(stream)};
  return Random(sequence);
}

/// In [low, high).
inline double Uniform(double low, double high, Random* random) {
  return std::uniform_real_distribution<double>(low, high)(*random);
}

/// N(0, sd²).
inline double Gaussian(double sd, Random* random) {
  return sd * std::normal_distribution<double>()(*random);
}

inline bool Happens(double probability, Random* random) {
  return Uniform(0.0, 1.0, random) < probability;
}

}  // namespace shiftmap
