// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mode_split.h"

#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

namespace shiftmap::testing {
namespace {

using Modes = std::vector<std::pair<int, double>>;

LandmarkGroup GroupOf(const std::vector<int>& numbers, const Modes& merged = {}) {
  LandmarkGroup group;
  for (const int number : numbers) group.modes.emplace_back().number = ModeNumber(number);
  for (const auto& [number, into] : merged) {
    group.merged.push_back({ModeNumber(number), ModeNumber(static_cast<int>(into))});
  }
  return group;
}

const ModeSplit kSplit{ModeNumber(1), ModeNumber(3), {"a"}, {"b"}};

Modes Split(const LandmarkGroup& group, const std::string& run, const Modes& row) {
  std::vector<VisitEvidence::ModeLogLikelihood> modes;
  for (const auto& [number, value] : row) modes.push_back({ModeNumber(number), value});
  SplitEvidence(group, kSplit, run, &modes);
  Modes result;
  for (const auto& mode : modes) {
    result.emplace_back(static_cast<int>(mode.mode.value()), mode.log_likelihood);
  }
  return result;
}

TEST(ModeSplitTest, AVisitOfAnUnnamedRunCountsForBothPlaces) {
  EXPECT_EQ(Split(GroupOf({1, 2, 3}), "c", {{0, -9.0}, {1, 0.0}, {2, -20.0}}),
            (Modes{{0, -9.0}, {1, 0.0}, {2, -20.0}, {3, 0.0}}));
}

TEST(ModeSplitTest, TheOtherPlaceOfANamedRunIsNoMoreLikelyThanAbsent) {
  const LandmarkGroup group = GroupOf({1, 2, 3});
  EXPECT_EQ(Split(group, "a", {{0, -9.0}, {1, 0.0}}), (Modes{{0, -9.0}, {1, 0.0}, {3, -9.0}}));
  EXPECT_EQ(Split(group, "b", {{0, -9.0}, {1, 0.0}}), (Modes{{0, -9.0}, {1, -9.0}, {3, 0.0}}));
  // In view and not seen: at neither of the two.
  EXPECT_EQ(Split(group, "b", {{0, 0.0}, {1, -4.0}}), (Modes{{0, 0.0}, {1, -4.0}, {3, -4.0}}));
}

TEST(ModeSplitTest, ARowThatKnowsBothPlacesOrNeitherStaysAsItIs) {
  const LandmarkGroup group = GroupOf({1, 2, 3});
  const Modes knows = {{0, 0.0}, {1, -1.0}, {3, -2.0}};
  EXPECT_EQ(Split(group, "a", knows), knows);
  const Modes older = {{0, 0.0}, {2, -1.0}};
  EXPECT_EQ(Split(group, "a", older), older);
  EXPECT_EQ(Split(GroupOf({2, 3}), "a", {{0, 0.0}, {1, -1.0}}), (Modes{{0, 0.0}, {1, -1.0}}));
}

TEST(ModeSplitTest, AModeThatWasMergedBeforeCountsAsPartOfIt) {
  EXPECT_EQ(Split(GroupOf({1, 3}, {{2, 1}}), "b", {{0, -9.0}, {1, -5.0}, {2, 0.0}}),
            (Modes{{0, -9.0}, {1, -9.0}, {2, -9.0}, {3, 0.0}}));
}

TEST(ModeSplitTest, AStatementIsSharedByBothPlaces) {
  const std::vector<StatedMode> stated = SplitStatement(
      GroupOf({1, 2, 3}), kSplit, {{kAbsent, 0.2}, {ModeNumber(1), 0.6}, {ModeNumber(2), 0.2}});
  ASSERT_EQ(stated.size(), 4U);
  EXPECT_DOUBLE_EQ(stated[1].probability, 0.3);
  EXPECT_EQ(stated[3].number, ModeNumber(3));
  EXPECT_DOUBLE_EQ(stated[3].probability, 0.3);
  // Of a mode that it does not name it says nothing.
  EXPECT_EQ(SplitStatement(GroupOf({1, 2, 3}), kSplit, {{kAbsent, 1.0}}).size(), 1U);
}

}  // namespace
}  // namespace shiftmap::testing
