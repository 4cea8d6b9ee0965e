// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/edited_map.h"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

#include "mapstore/map/frame_change.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/mapstore/map/edit_test_util.h"

namespace shiftmap::testing {
namespace {

class EditedMapTest : public ::testing::Test {
 protected:
  EditedMapTest() {
    std::mt19937_64 random(TestSeed(4));
    content_ = RandomContent(random, {.groups = 4, .vehicles = 2, .cross_block_share = 1.0});
    content_.groups[1] = RandomGroup(random, content_.groups[1].signature.text(), 3);
    for (LandmarkGroup& group : content_.groups) names_.push_back(group.signature.text());
    std::vector<Eigen::Matrix2d> diagonal;
    for (const LandmarkGroup& group : content_.groups) {
      for (const Mode& mode : group.modes) diagonal.push_back(mode.cov_p_map_landmark);
    }
    std::vector<JointCovariance::CrossBlock> cross;
    for (int row = 0; row < static_cast<int>(diagonal.size()); ++row) {
      for (int column = row + 1; column < static_cast<int>(diagonal.size()); ++column) {
        cross.push_back({row, column, Eigen::Matrix2d::Constant(1e-6 * (10 * row + column))});
      }
    }
    content_.covariance = JointCovariance(diagonal, cross);
  }

  // The cross block of two modes by name and number.
  static Eigen::Matrix2d Cross(const MapContent& content,
                               const std::string& a,
                               int mode_a,
                               const std::string& b,
                               int mode_b) {
    int row = 0;
    int of_a = -1;
    int of_b = -1;
    for (const LandmarkGroup& group : content.groups) {
      for (const Mode& mode : group.modes) {
        if (group.signature.text() == a && mode.number == ModeNumber(mode_a)) of_a = row;
        if (group.signature.text() == b && mode.number == ModeNumber(mode_b)) of_b = row;
        ++row;
      }
    }
    EXPECT_GE(of_a, 0);
    EXPECT_GE(of_b, 0);
    return content.covariance.Block(of_a, of_b);
  }

  MapContent content_;
  std::vector<std::string> names_;
};

// Each counts once: the map is that of all at once.
TEST_F(EditedMapTest, ControlPointsComeOneAtATime) {
  EditedMap map(content_, {});
  std::vector<ControlPoint> points;
  for (const std::size_t i : {0, 2, 3}) {
    MapEdit edit = MakeEdit(EditKind::kControl, names_[i]);
    edit.id = EditId(static_cast<std::int64_t>(i) + 1);
    edit.mode = content_.groups[i].modes[0].number;
    edit.p_map_landmark = content_.groups[i].modes[0].p_map_landmark +
                          Eigen::Vector2d(0.02 * static_cast<double>(i), -0.01);
    edit.sd_m = 0.02;
    ASSERT_THAT(map.Apply(edit), IsOk());
    points.push_back({edit.landmark, edit.mode, edit.p_map_landmark, edit.sd_m});
  }
  MapContent once = content_;
  HoldControlPoints(points, 0, &once);
  const Eigen::MatrixXd expected = once.covariance.Dense();
  EXPECT_THAT(map.content().covariance.Dense(),
              IsNearMatrix(expected, 0.01 * expected.diagonal().minCoeff()));
  const auto difference = (expected - content_.covariance.Dense()).eval();
  EXPECT_GT(difference.cwiseAbs().maxCoeff(), expected.diagonal().minCoeff());
}

TEST_F(EditedMapTest, ARenamedLandmarkGoesInOrderWithItsCorrelations) {
  EditedMap map(content_, {});
  ASSERT_THAT(map.Apply(MakeRename(names_[0], "zz", 1)), IsOk());
  EXPECT_THAT(ValidateMapContent(map.content()), IsOk());
  EXPECT_EQ(map.content().groups.back().signature.text(), "zz");
  EXPECT_THAT(Cross(map.content(), "zz", 1, names_[1], 2),
              IsNearMatrix(Cross(content_, names_[0], 1, names_[1], 2), 0.0));
  // A second one of the same landmark, and the first taken back after runs were added.
  EditedMap later(map.content(), map.held());
  ASSERT_THAT(later.Reverse(map.held()[0], EditedMap(content_, {})), IsOk());
  EXPECT_EQ(GeometryHash(later.content()), GeometryHash(content_));
}

TEST_F(EditedMapTest, ANameThatIsTakenIsRefused) {
  EditedMap map(content_, {});
  EXPECT_THAT(map.Apply(MakeRename(names_[0], names_[1], 1)),
              StatusIs(StatusCode::kInvalidArgument, "is another landmark of the map"));
}

TEST_F(EditedMapTest, ASurveyedPositionReplacesTheModesAndItsCorrelations) {
  EditedMap map(content_, {});
  MapEdit edit = MakeEdit(EditKind::kPosition, names_[1]);
  edit.mode = ModeNumber(2);
  edit.p_map_landmark = {1.0, 2.0};
  edit.sd_m = 0.5;
  ASSERT_THAT(map.Apply(edit), IsOk());
  EXPECT_THAT(ValidateMapContent(map.content()), IsOk());
  const Mode& mode = map.content().groups[1].modes[1];
  EXPECT_EQ(mode.p_map_landmark, Eigen::Vector2d(1.0, 2.0));
  EXPECT_EQ(mode.cov_p_map_landmark, Eigen::Matrix2d(0.25 * Eigen::Matrix2d::Identity()));
  EXPECT_EQ(Cross(map.content(), names_[1], 2, names_[0], 1), Eigen::Matrix2d::Zero());
  EXPECT_EQ(Cross(map.content(), names_[1], 1, names_[0], 1),
            Cross(content_, names_[1], 1, names_[0], 1));
  edit.mode = ModeNumber(9);
  EXPECT_THAT(map.Apply(edit), StatusIs(StatusCode::kNotFound, "no mode 9"));
}

TEST_F(EditedMapTest, TheNumberOfANewModeThatIsTakenBackIsNotGivenAgain) {
  EditedMap map(content_, {});
  MapEdit edit = MakeEdit(EditKind::kNewMode, names_[1]);
  edit.sd_m = 0.1;
  ASSERT_THAT(map.Complete(&edit), IsOk());
  EXPECT_EQ(edit.mode, ModeNumber(4));
  ASSERT_THAT(map.Apply(edit), IsOk());
  EXPECT_THAT(ValidateMapContent(map.content()), IsOk());
  ASSERT_TRUE(map.IsReversible(edit));
  ASSERT_THAT(map.Reverse(edit, EditedMap(content_, {})), IsOk());
  EXPECT_THAT(ValidateMapContent(map.content()), IsOk());
  EXPECT_EQ(map.content().groups[1].modes.size(), 3U);
  EXPECT_EQ(map.content().groups[1].NextNumber(), ModeNumber(5));
  // Who saw the landmark there saw it at no known position.
  EXPECT_EQ(map.content().groups[1].CarriedStateOf(ModeNumber(4)), 0);

  EditedMap without(content_, {});
  without.Reserve(edit);
  EXPECT_EQ(GeometryHash(without.content()), GeometryHash(map.content()));
}

TEST_F(EditedMapTest, AMergedModeIsPartOfTheOtherAndComesBack) {
  EditedMap map(content_, {});
  MapEdit edit = MakeEdit(EditKind::kMerge, names_[1]);
  edit.id = EditId(1);
  edit.mode = ModeNumber(1);
  edit.into = ModeNumber(3);
  ASSERT_THAT(map.Apply(edit), IsOk());
  EXPECT_THAT(ValidateMapContent(map.content()), IsOk());
  const LandmarkGroup& group = map.content().groups[1];
  EXPECT_EQ(group.CarriedStateOf(ModeNumber(1)), group.StateOf(ModeNumber(3)));
  EXPECT_NEAR(group.probabilities(group.StateOf(ModeNumber(3))),
              content_.groups[1].probabilities(1) + content_.groups[1].probabilities(3),
              1e-12);
  ASSERT_THAT(map.Reverse(edit, EditedMap(content_, {})), IsOk());
  EXPECT_THAT(ValidateMapContent(map.content()), IsOk());
  EXPECT_EQ(map.content().groups[1].StateOf(ModeNumber(1)), 1);
  EXPECT_TRUE(map.content().groups[1].merged.empty());
  edit.into = ModeNumber(1);
  EXPECT_THAT(map.Apply(edit), StatusIs(StatusCode::kInvalidArgument, "part of itself"));
}

TEST_F(EditedMapTest, ASplitModeIsTwoPlacesThatShareItsProbability) {
  EditedMap map(content_, {});
  MapEdit edit = MakeEdit(EditKind::kSplit, names_[1]);
  edit.id = EditId(1);
  edit.mode = ModeNumber(2);
  edit.p_map_landmark = {5.0, 6.0};
  edit.p_map_second = {7.0, 8.0};
  edit.sd_m = 0.1;
  ASSERT_THAT(map.Complete(&edit), IsOk());
  EXPECT_EQ(edit.into, ModeNumber(4));
  ASSERT_THAT(map.Apply(edit), IsOk());
  EXPECT_THAT(ValidateMapContent(map.content()), IsOk());
  const LandmarkGroup& before = content_.groups[1];
  const LandmarkGroup& group = map.content().groups[1];
  ASSERT_EQ(group.modes.size(), 4U);
  EXPECT_EQ(group.modes[1].p_map_landmark, edit.p_map_landmark);
  EXPECT_EQ(group.modes[3].p_map_landmark, edit.p_map_second);
  EXPECT_EQ(group.modes[3].last_seen, before.modes[1].last_seen);
  EXPECT_DOUBLE_EQ(group.chain.leave_rate_per_s(), before.chain.leave_rate_per_s());
  EXPECT_NEAR(group.probabilities(1), before.probabilities(1), 1e-12);
  EXPECT_NEAR(group.probabilities(2), 0.5 * before.probabilities(2), 1e-12);
  EXPECT_NEAR(group.probabilities(4), 0.5 * before.probabilities(2), 1e-12);
  EXPECT_TRUE(Cross(map.content(), names_[1], 2, names_[2], 1).isZero());
  EXPECT_EQ(Cross(map.content(), names_[1], 1, names_[2], 1),
            Cross(content_, names_[1], 1, names_[2], 1));
  EXPECT_THAT(map.Apply(edit), StatusIs(StatusCode::kInvalidArgument, "has had a mode 4"));

  // Taken back, the number stays, and evidence of the second place is evidence of the mode.
  EditedMap plain(content_, {});
  plain.Reserve(edit);
  EXPECT_EQ(plain.content().groups[1].CarriedStateOf(ModeNumber(4)), 2);
  EXPECT_EQ(plain.content().groups[1].NextNumber(), ModeNumber(5));
}

// The survey is of the place that went, 5 m from the mode that took it over.
TEST_F(EditedMapTest, AControlPointOfAMergedModeHoldsNothing) {
  MapEdit control = MakeEdit(EditKind::kControl, names_[1]);
  control.id = EditId(1);
  control.mode = ModeNumber(1);
  control.p_map_landmark = content_.groups[1].modes[0].p_map_landmark;
  control.sd_m = 0.02;
  EditedMap map(content_, {});
  ASSERT_THAT(map.Apply(control), IsOk());
  EXPECT_EQ(ControlPointsOf(map.held()).size(), 1U);
  MapEdit merge = MakeEdit(EditKind::kMerge, names_[1]);
  merge.id = EditId(2);
  merge.mode = ModeNumber(1);
  merge.into = ModeNumber(3);
  ASSERT_THAT(map.Apply(merge), IsOk());
  MapContent held = map.content();
  const std::vector<ControlPoint> points = ControlPointsOf(map.held());
  EXPECT_EQ(HoldControlPoints(points, points.size(), &held).translation().norm(), 0.0);
  EXPECT_EQ(GeometryHash(held), GeometryHash(map.content()));
  // Another mode's point holds on.
  control.mode = ModeNumber(2);
  EXPECT_EQ(ControlPointsOf({control, merge}).size(), 1U);
}

// A build that saw the landmark where the merged mode was has made a mode there.
TEST_F(EditedMapTest, AMergedModeDoesNotComeBackBesideOneThatWasMadeAtItsPlace) {
  MapEdit merge = MakeEdit(EditKind::kMerge, names_[1]);
  merge.id = EditId(1);
  merge.mode = ModeNumber(1);
  merge.into = ModeNumber(3);
  EditedMap map(content_, {});
  ASSERT_THAT(map.Apply(merge), IsOk());
  const Eigen::Vector2d place = content_.groups[1].modes[0].p_map_landmark;
  for (const double offset_m : {0.03, 300.0}) {
    EditedMap build(map.content(), {});
    MapEdit made = MakeEdit(EditKind::kNewMode, names_[1]);
    made.mode = ModeNumber(4);
    made.p_map_landmark = place + Eigen::Vector2d(offset_m, 0.0);
    made.sd_m = 0.02;
    ASSERT_THAT(build.Apply(made), IsOk());
    EditedMap later(build.content(), map.held());
    ASSERT_THAT(later.Reverse(merge, EditedMap(content_, {})), IsOk());
    EXPECT_THAT(ValidateMapContent(later.content()), IsOk());
    const LandmarkGroup& group = later.content().groups[1];
    const bool same = offset_m < 1.0;
    EXPECT_EQ(group.modes.size(), same ? 3U : 4U) << offset_m;
    EXPECT_EQ(group.CarriedStateOf(ModeNumber(1)), same ? group.StateOf(ModeNumber(4)) : 1);
  }
}

// Lumping two states of a chain in which they are alike is exact: the other states see one chain.
TEST_F(EditedMapTest, TheChainOfMergedModesKeepsTheRatesOfTheOthers) {
  Eigen::MatrixXd rates(4, 4);
  rates << 0, 1, 2, 1, 3, 0, 1, 2, 1, 5, 0, 5, 3, 2, 1, 0;  // 1 and 3 leave alike.
  rates *= 1e-5;
  rates.diagonal() = -rates.rowwise().sum();
  content_.groups[1].chain = *ModeChain::FromRates(rates);
  EditedMap map(content_, {});
  MapEdit edit = MakeEdit(EditKind::kMerge, names_[1]);
  edit.mode = ModeNumber(1);
  edit.into = ModeNumber(3);
  ASSERT_THAT(map.Apply(edit), IsOk());
  const Eigen::MatrixXd lumped = map.content().groups[1].chain.rate_matrix();
  EXPECT_NEAR(lumped(0, 2), 2e-5, 1e-12);
  EXPECT_NEAR(lumped(1, 2), 10e-5, 1e-12);
  EXPECT_NEAR(lumped(2, 0), 3e-5, 1e-12);
  EXPECT_NEAR(lumped(2, 1), 1e-5, 1e-12);
}

TEST_F(EditedMapTest, ARetiredLandmarkComesBackAsItWas) {
  EditedMap map(content_, {});
  MapEdit edit = MakeEdit(EditKind::kRetire, names_[2]);
  edit.id = EditId(1);
  ASSERT_THAT(map.Apply(edit), IsOk());
  EXPECT_THAT(ValidateMapContent(map.content()), IsOk());
  EXPECT_EQ(map.content().groups.size(), 3U);
  EXPECT_EQ(Cross(map.content(), names_[0], 1, names_[3], 1),
            Cross(content_, names_[0], 1, names_[3], 1));
  ASSERT_THAT(map.Reverse(edit, EditedMap(content_, {})), IsOk());
  EXPECT_THAT(ValidateMapContent(map.content()), IsOk());
  EXPECT_EQ(map.content().groups[2].modes[0].p_map_landmark,
            content_.groups[2].modes[0].p_map_landmark);
  edit.signature = edit.landmark = Signature("nobody");
  EXPECT_THAT(map.Apply(edit), StatusIs(StatusCode::kNotFound, "no landmark 'nobody'"));
}

// As control points move it.
TEST_F(EditedMapTest, WhatComesBackStandsInTheFrameOfNow) {
  const Se2 T_new_old(300.0, -500.0, 0.4);
  MapEdit retire = MakeEdit(EditKind::kRetire, names_[2]);
  MapEdit merge = MakeEdit(EditKind::kMerge, names_[1]);
  merge.mode = ModeNumber(1);
  merge.into = ModeNumber(3);
  for (MapEdit* edit : {&retire, &merge}) {
    edit->id = EditId(1);
    EditedMap map(content_, {});
    ASSERT_THAT(map.Apply(*edit), IsOk());
    MapContent moved = map.content();
    MoveContent(T_new_old, &moved);
    EditedMap later(moved, map.held());
    ASSERT_THAT(later.Reverse(*edit, EditedMap(content_, {})), IsOk());
    const std::size_t g = edit == &retire ? 2 : 1;
    const Mode& before = content_.groups[g].modes[0];
    const Mode& after = later.content().groups[g].modes[0];
    EXPECT_LT((after.p_map_landmark - T_new_old * before.p_map_landmark).norm(), 1e-3);
    const Eigen::Matrix2d R = T_new_old.Rotation();
    EXPECT_LT((after.cov_p_map_landmark - R * before.cov_p_map_landmark * R.transpose()).norm(),
              1e-3 * before.cov_p_map_landmark.norm());
  }
}

// Of a chain that jumped once in the time of the evidence, and a statement of as much weight.
TEST_F(EditedMapTest, AStatedRateWeighsAgainstWhatWasSeen) {
  content_.groups[0].chain = ModeChain::Uniform(content_.groups[0].chain.states() - 1, 1e-4);
  EditedMap map(content_, {});
  MapEdit edit = MakeEdit(EditKind::kRate, names_[0]);
  edit.rate_per_s = 1e-2;
  edit.weight = 1.0;
  edit.evidence_s = 1e4;
  ASSERT_THAT(map.Apply(edit), IsOk());
  EXPECT_NEAR(map.content().groups[0].chain.leave_rate_per_s(), 2.0 / (1e4 + 1e2), 1e-15);
}

TEST_F(EditedMapTest, WhatIsKnownOfAVehicleIsForgottenAndComesBack) {
  const VehicleCalibration known = content_.vehicles[0];
  EditedMap map(content_, {});
  MapEdit edit = MakeEdit(EditKind::kCalibration, "");
  edit.id = EditId(1);
  edit.vehicle = known.vehicle;
  edit.since = known.stamp;
  ASSERT_THAT(map.Apply(edit), IsOk());
  ASSERT_EQ(map.content().vehicles.size(), 1U);
  ASSERT_THAT(map.Reverse(edit, EditedMap(content_, {})), IsOk());
  EXPECT_EQ(GeometryHash(map.content()), GeometryHash(content_));
  edit.since = known.stamp + Duration(1);
  EXPECT_THAT(map.Apply(edit), StatusIs(StatusCode::kNotFound, "nothing is known"));
  edit.vehicle = "nobody";
  EXPECT_THAT(map.Apply(edit), StatusIs(StatusCode::kNotFound, "vehicle 'nobody'"));
}

}  // namespace
}  // namespace shiftmap::testing
