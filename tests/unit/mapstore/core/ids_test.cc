// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/ids.h"

#include <gtest/gtest.h>

#include <type_traits>
#include <unordered_set>

namespace shiftmap::testing {
namespace {

static_assert(!std::is_convertible_v<int, ModeNumber>);
static_assert(!std::is_convertible_v<ModeNumber, VersionNumber>);

TEST(IdsTest, CompareAndHash) {
  EXPECT_LT(ModeNumber(1), ModeNumber(2));
  EXPECT_EQ(ModeNumber(), kAbsent);
  EXPECT_EQ((std::unordered_set<VersionNumber>{VersionNumber(1), VersionNumber(1)}).size(), 1u);
}

TEST(SignatureTest, ComparesAsBytes) {
  EXPECT_LT(Signature("18"), Signature("9"));
  EXPECT_LT(Signature("a"), Signature("\xc3\xa4"));
  EXPECT_LT(Signature("a"), Signature(std::string("a\0", 2)));
  EXPECT_TRUE(Signature().anonymous());
  EXPECT_FALSE(Signature("0").anonymous());
  EXPECT_EQ((std::unordered_set<Signature>{Signature("x"), Signature("x")}).size(), 1u);
}

}  // namespace
}  // namespace shiftmap::testing
