// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/map_edit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <string>
#include <vector>

#include "tests/support/status_matchers.h"
#include "tests/unit/mapstore/map/edit_test_util.h"

namespace shiftmap::testing {
namespace {

using ::testing::ElementsAre;
using ::testing::Pair;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

TEST(LandmarkNamesTest, FollowRenamesOfRenames) {
  const LandmarkNames names({MakeRename("A", "B", 1), MakeRename("A", "C", 2)});
  EXPECT_EQ(names.Landmark(Signature("B")), Signature("A"));
  EXPECT_EQ(names.Landmark(Signature("C")), Signature("A"));
  EXPECT_EQ(names.Landmark(Signature("X")), Signature("X"));
  EXPECT_EQ(names.Name(Signature("A")), Signature("C"));
  EXPECT_THAT(
      names.Aliases(),
      ElementsAre(Pair(Signature("A"), Signature("C")), Pair(Signature("B"), Signature("C"))));
}

TEST(ValidateEditTest, RefusesWhatIsNoNumberAndNoText) {
  MapEdit edit = MakeEdit(EditKind::kControl, "A");
  edit.sd_m = 0.02;
  EXPECT_THAT(ValidateEdit(edit), IsOk());
  for (const double sd : {0.0, -1.0, kNan, std::numeric_limits<double>::infinity()}) {
    edit.sd_m = sd;
    EXPECT_THAT(ValidateEdit(edit), StatusIs(StatusCode::kInvalidArgument, "standard deviation"));
  }
  edit.sd_m = 0.02;
  for (const double x : {kNan, 1e10, -std::numeric_limits<double>::infinity()}) {
    edit.p_map_landmark.x() = x;
    EXPECT_THAT(ValidateEdit(edit), StatusIs(StatusCode::kInvalidArgument, "position ("));
  }
  edit = MakeEdit(EditKind::kRate, "A");
  edit.weight = 1.0;
  for (const double rate : {0.0, -1.0, kNan, 1e9}) {
    edit.rate_per_s = rate;
    EXPECT_THAT(ValidateEdit(edit), StatusIs(StatusCode::kInvalidArgument, "rate"));
  }
  edit = MakeEdit(EditKind::kRetire, "A");
  for (const std::string reason : {"", "  ", "two\nlines", "\x1b[31mred", "\xff"}) {
    edit.reason = reason;
    EXPECT_THAT(ValidateEdit(edit), StatusIs(StatusCode::kInvalidArgument, "reason: "));
  }
  edit = MakeRename("A", "\x1b]0;title\a", 1);
  EXPECT_THAT(ValidateEdit(edit),
              StatusIs(StatusCode::kInvalidArgument, "new name: '\\x1b]0;title\\x07', expected"));
}

}  // namespace
}  // namespace shiftmap::testing
