// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <bit>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <numeric>
#include <vector>

#include "mapper/index.h"

namespace shiftmap {

/// Matches in one set at most: thirty landmarks with four modes in each of two maps.
inline constexpr int kMaxMatches = 512;

/// A set of matches, those before kMaxMatches. Ordered, so that results do not depend on where
/// sets are in memory.
class MatchSet {
 public:
  MatchSet() = default;

  /// The matches whose bits are set.
  static MatchSet OfBits(std::uint64_t bits) {
    MatchSet set;
    set.words_.front() = bits;
    return set;
  }

  static MatchSet Of(MatchIndex match) { return MatchSet().Flipped(match); }

  bool empty() const { return *this == MatchSet(); }

  int Count() const {
    return std::accumulate(words_.begin(), words_.end(), 0, [](int sum, std::uint64_t word) {
      return sum + std::popcount(word);
    });
  }

  /// By ascending index.
  std::vector<MatchIndex> Members() const {
    std::vector<MatchIndex> members;
    for (std::size_t i = 0; i < kWords; ++i) {
      for (std::uint64_t left = words_[i]; left != 0; left &= left - 1) {
        members.push_back(MatchIndex(i * kBits) + std::countr_zero(left));
      }
    }
    return members;
  }

  bool Contains(MatchIndex match) const {
    return ((words_[WordOf(match)] >> BitOf(match)) & 1) != 0;
  }

  bool Includes(const MatchSet& other) const { return (*this & other) == other; }

  bool Intersects(const MatchSet& other) const { return !(*this & other).empty(); }

  /// With the match if it is not in the set, else without it.
  MatchSet Flipped(MatchIndex match) const {
    MatchSet set = *this;
    set.words_[WordOf(match)] ^= std::uint64_t{1} << BitOf(match);
    return set;
  }

  MatchSet Without(const MatchSet& other) const {
    MatchSet set;
    for (std::size_t i = 0; i < kWords; ++i) set.words_[i] = words_[i] & ~other.words_[i];
    return set;
  }

  friend MatchSet operator&(const MatchSet& a, const MatchSet& b) {
    MatchSet set;
    for (std::size_t i = 0; i < kWords; ++i) set.words_[i] = a.words_[i] & b.words_[i];
    return set;
  }

  friend MatchSet operator|(const MatchSet& a, const MatchSet& b) {
    MatchSet set;
    for (std::size_t i = 0; i < kWords; ++i) set.words_[i] = a.words_[i] | b.words_[i];
    return set;
  }

  auto operator<=>(const MatchSet&) const = default;

  std::size_t Hash() const {
    constexpr std::uint64_t kMultiplier = 0x9E3779B97F4A7C15;  // 2^64 by the golden ratio.
    std::uint64_t hash = 0;
    for (const std::uint64_t word : words_) {
      hash = (std::rotl(hash, 23) ^ word) * kMultiplier;
      hash = (hash ^ (hash >> 32)) * kMultiplier;
    }
    return static_cast<std::size_t>(hash);
  }

 private:
  static constexpr std::size_t kBits = 64;
  static constexpr std::size_t kWords = kMaxMatches / kBits;

  static std::size_t Place(MatchIndex match) { return static_cast<std::size_t>(match.value()); }
  static std::size_t WordOf(MatchIndex match) { return Place(match) / kBits; }
  static std::size_t BitOf(MatchIndex match) { return Place(match) % kBits; }

  std::array<std::uint64_t, kWords> words_{};
};

}  // namespace shiftmap

template <>
struct std::hash<shiftmap::MatchSet> {
  std::size_t operator()(const shiftmap::MatchSet& set) const { return set.Hash(); }
};
