// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/match_set.h"

#include <gtest/gtest.h>

#include <bitset>
#include <random>
#include <set>
#include <unordered_set>
#include <vector>

namespace shiftmap {
namespace {

using Bits = std::bitset<kMaxMatches>;

MatchSet OfBitset(const Bits& bits) {
  MatchSet set;
  for (std::size_t k = 0; k < kMaxMatches; ++k) {
    if (bits[k]) set = set.Flipped(MatchIndex(k));
  }
  return set;
}

Bits DrawBits(std::mt19937_64* random) {
  Bits bits;
  for (int i = 0; i < 40; ++i) bits.set((*random)() % kMaxMatches);
  return bits;
}

// The oracle: the standard library's sets of bits.
TEST(MatchSetTest, IsASet) {
  std::mt19937_64 random(1);
  for (int round = 0; round < 50; ++round) {
    const Bits x = DrawBits(&random);
    const Bits y = DrawBits(&random);
    const MatchSet a = OfBitset(x);
    const MatchSet b = OfBitset(y);
    EXPECT_EQ(a & b, OfBitset(x & y));
    EXPECT_EQ(a | b, OfBitset(x | y));
    EXPECT_EQ(a.Without(b), OfBitset(x & ~y));
    EXPECT_EQ(a.Count(), static_cast<int>(x.count()));
    EXPECT_EQ(a.Intersects(b), (x & y).any());
    EXPECT_EQ(a.Includes(b), (x & y) == y);
    EXPECT_TRUE((a | b).Includes(b));
    MatchSet again;
    MatchIndex last = -1;
    for (const MatchIndex k : a.Members()) {
      EXPECT_GT(k, last);
      EXPECT_TRUE(x[static_cast<std::size_t>(k.value())] && a.Contains(k));
      again = again.Flipped(last = k);
    }
    EXPECT_EQ(again, a);
    EXPECT_EQ(again.Flipped(last), a.Without(MatchSet::Of(last)));
  }
  EXPECT_TRUE(MatchSet().empty());
  EXPECT_EQ(MatchSet::OfBits(0b1011), MatchSet::Of(0).Flipped(1).Flipped(3));
}

TEST(MatchSetTest, SetsThatDifferHaveDifferentHashes) {
  std::set<MatchSet> sets;
  std::unordered_set<std::size_t> hashes;
  const MatchIndex end(kMaxMatches);
  for (MatchIndex j = 0; j < end; ++j) {
    for (MatchIndex k = j; k < end; ++k) {
      const MatchSet set = j == k ? MatchSet::Of(j) : MatchSet::Of(j).Flipped(k);
      sets.insert(set);
      hashes.insert(set.Hash());
    }
  }
  EXPECT_EQ(sets.size(), kMaxMatches * (kMaxMatches + 1) / 2);
  EXPECT_EQ(hashes.size(), sets.size());
}

}  // namespace
}  // namespace shiftmap
