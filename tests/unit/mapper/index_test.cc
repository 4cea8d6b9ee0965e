// SPDX-License-Identifier: Apache-2.0
#include "mapper/index.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <type_traits>
#include <vector>

namespace shiftmap {
namespace {

template <typename List, typename Index>
concept IndexedBy = requires(List list, Index i) {
  list[i];
};

using Runs = IndexedVector<RunIndex, double>;

static_assert(IndexedBy<Runs, RunIndex>);
static_assert(!IndexedBy<Runs, ModeIndex>);
static_assert(!IndexedBy<Runs, std::size_t>);
static_assert(!std::is_convertible_v<std::ptrdiff_t, RunIndex>);
static_assert(sizeof(RunIndex) == sizeof(int) && sizeof(Runs) == sizeof(std::vector<double>));

TEST(IndexedVector, IndicesAreThoseOfAllItemsInOrder) {
  Runs runs = {2.0, 3.0, 5.0};
  for (const RunIndex i : runs.indices()) runs[i] *= 10.0;
  EXPECT_THAT(runs, ::testing::ElementsAre(20.0, 30.0, 50.0));
  EXPECT_EQ(runs.end_index(), RunIndex(3));
  for (const RunIndex i : Runs().indices()) FAIL() << i.value();
}

TEST(TypedIndex, CountsAndFindsRows) {
  const FrameIndex frame = 4;
  EXPECT_EQ(frame + 3, FrameIndex(7));
  EXPECT_EQ(frame - 3, FrameIndex(1));
  EXPECT_EQ(frame - FrameIndex(1), 3);
  EXPECT_EQ(3 * frame, 12);
  EXPECT_TRUE(frame == 4 && frame < 5);
}

}  // namespace
}  // namespace shiftmap
