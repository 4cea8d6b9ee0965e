// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_utias.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "localizer/models/observation_model.h"
#include "mapstore/geometry/covariance.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tools/experiment/experiments.h"
#include "tools/experiment/ijrr_utias_data.h"
#include "tools/experiment/ijrr_utias_score.h"
#include "tools/experiment/ijrr_utias_selectors.h"
#include "tools/experiment/ijrr_utias_static.h"

namespace shiftmap {
namespace {

constexpr char kNoRecordedData[] =
    "no UTIAS data: set SHIFTMAP_DATA to the folder that holds utias";

// The folder of the recorded data sets; empty if they are not there.
std::string RecordedData() {
  const char* data = std::getenv("SHIFTMAP_DATA");
  const std::string folder = std::string(data == nullptr ? "" : data) + "/utias";
  return std::filesystem::exists(folder + "/MRCLAM_Dataset1") ? folder : "";
}

using testing::IsOk;
using testing::StatusIs;

Observation Seen(const std::string& signature, double range_m, double bearing_rad) {
  Observation observation;
  observation.signature = Signature(signature);
  observation.z = {range_m, bearing_rad};
  return observation;
}

// A vehicle that stands at the origin for `scans` scans, a second apart, and sees one landmark.
UtiasCase StandingCase(int scans) {
  UtiasCase data;
  data.landmarks[Signature("a")] = {2.0, 0.0};
  data.signatures = {Signature("a")};
  for (int i = 0; i < scans; ++i) {
    const Stamp stamp = StampFromSeconds(100.0 + i);
    data.run.odometry.push_back({stamp, 0.0, 0.0});
    data.run.scans.push_back({stamp, {Seen("a", 2.0, 0.0)}});
    data.truth.push_back({stamp, Se2()});
  }
  data.frames = MakeMappingRun(data.run, data.signatures, {});
  return data;
}

TEST(IjrrUtiasTest, OnlyTheFieldOfViewTakesPart) {
  shiftmap::Run run;
  run.scans.push_back({Stamp(), {Seen("in", 4.9, 0.39), Seen("far", 5.1, 0.0)}});
  run.scans.push_back({Stamp(), {Seen("left", 1.0, 0.41), Seen("right", 1.0, -0.41)}});
  run = WithinFieldOfView(run, 5.0, 0.4);
  ASSERT_EQ(run.scans.size(), 2u);
  ASSERT_EQ(run.scans[0].observations.size(), 1u);
  EXPECT_EQ(run.scans[0].observations[0].signature.text(), "in");
  EXPECT_TRUE(run.scans[1].observations.empty());
}

TEST(IjrrUtiasTest, TheGroupStandsClosestTogether) {
  LandmarkPlaces places;
  places[Signature("a")] = {0.0, 0.0};
  places[Signature("b")] = {5.0, 5.0};
  places[Signature("c")] = {1.0, 0.0};
  places[Signature("d")] = {5.0, 6.5};
  places[Signature("e")] = {0.0, 1.0};
  const std::vector<Signature> expected = {Signature("a"), Signature("c"), Signature("e")};
  EXPECT_EQ(ClosestTogether(places, 3), expected);
  const LandmarkPlaces displaced = Displaced(places, expected, 0.5);
  EXPECT_EQ(displaced.at(Signature("c")), Eigen::Vector2d(1.5, 0.0));
  EXPECT_EQ(displaced.at(Signature("b")), places.at(Signature("b")));
}

TEST(IjrrUtiasTest, TheSurveyIsAValidMap) {
  LandmarkPlaces places;
  places[Signature("a")] = {0.0, 0.0};
  places[Signature("b")] = {5.0, 5.0};
  EXPECT_THAT(ValidateMapContent(SurveyMap(places, 0.05, StampFromSeconds(1.0))), IsOk());
}

TEST(IjrrUtiasTest, OneMisreadSightingWeighsAsOneInItsVisit) {
  const UtiasCase data = StandingCase(10);
  ASSERT_EQ(data.frames.visits.size(), 1u);
  UtiasEstimate estimate;
  estimate.poses.assign(10, Se2(0.3, 0.4, 0.0));
  estimate.modes = {{{2.0, 0.1}, {12.0, 0.0}, {99.0, 0.0}}};
  estimate.sighting_modes.assign(10, 0);
  estimate.sighting_modes.back() = 1;
  const UtiasScore score = ScoreUtias(data, estimate);
  EXPECT_NEAR(score.pose_rmse_m, 0.5, 1e-12);
  EXPECT_NEAR(score.landmark_rmse_m, std::sqrt(0.9 * 0.01 + 0.1 * 100.0), 1e-12);
  EXPECT_EQ(score.modes, 3);
  EXPECT_EQ(score.poses, 10);
}

TEST(IjrrUtiasTest, AVisitCountsOneHoweverLongItIs) {
  UtiasCase data = StandingCase(30);
  // Between the first and the last twenty sightings nothing is seen for eleven seconds.
  data.run.scans.erase(data.run.scans.begin() + 1, data.run.scans.begin() + 11);
  data.frames = MakeMappingRun(data.run, data.signatures, {});
  ASSERT_EQ(data.frames.visits.size(), 2u);
  UtiasEstimate estimate;
  estimate.poses.assign(data.frames.frames.size(), Se2());
  estimate.modes = {{{3.0, 0.0}, {2.0, 0.0}}};
  estimate.sighting_modes.assign(data.frames.sightings.size(), 1);
  estimate.sighting_modes.front() = 0;
  EXPECT_NEAR(ScoreUtias(data, estimate).landmark_rmse_m, std::sqrt(0.5), 1e-12);
}

TEST(IjrrUtiasTest, WhatNothingExplainsStandsAtItsFirstMode) {
  const UtiasCase data = StandingCase(3);
  UtiasEstimate estimate;
  estimate.poses.assign(3, Se2());
  estimate.modes = {{{2.5, 0.0}, {2.0, 0.0}}};
  estimate.sighting_modes.assign(3, -1);
  EXPECT_NEAR(ScoreUtias(data, estimate).landmark_rmse_m, 0.5, 1e-12);
}

TEST(IjrrUtiasTest, PrintedNoiseOfTheOdometryGrowsBySamples) {
  const UtiasCase data = StandingCase(2);
  const std::vector<MotionIncrement> motions = UtiasMotions(data, PrintedNoise(1));
  ASSERT_EQ(motions.size(), 1u);
  // 50 samples of (0.02 · 0.01)² in a second.
  EXPECT_TRUE(motions[0].cov.isApprox(Eigen::Matrix3d::Identity() * 50.0 * 4e-8, 1e-9));
}

TEST(IjrrUtiasTest, FrameByFrameALandmarkThatStandsElsewhereIsAMode) {
  const UtiasCase data = StandingCase(10);
  UtiasNoise noise;
  noise.sensor.sd_range_m = 0.05;
  LandmarkPlaces map = data.landmarks;
  map.begin()->second.x() += 1.0;
  const IncrementalOptions options = OwnSelectorOptions(noise, UtiasProtocol());
  const StatusOr<UtiasEstimate> estimate = SolveFrameByFrame(data, noise, map, 0.05, options);
  ASSERT_THAT(estimate, IsOk());
  EXPECT_EQ(estimate->created, 1);
  ASSERT_EQ(estimate->modes[0].size(), 2u);
  EXPECT_NEAR(estimate->modes[0][0].x(), 3.0, 0.05);
  EXPECT_NEAR(estimate->modes[0][1].x(), 2.0, 0.05);
  EXPECT_EQ(estimate->step_poses.size(), 10u);
  EXPECT_EQ(estimate->sighting_modes, std::vector<int>(10, 1));
}

TEST(IjrrUtiasTest, RejectsWhatIsOutOfRange) {
  IjrrUtiasOptions options;
  options.methods = {"magic"};
  EXPECT_THAT(options.Validate(), StatusIs(StatusCode::kInvalidArgument, "magic"));
  options = {};
  options.deltas_m = {};
  EXPECT_THAT(options.Validate(), StatusIs(StatusCode::kInvalidArgument, "displacements"));
  options = {};
  options.realizations = 0;
  EXPECT_THAT(options.Validate(), StatusIs(StatusCode::kInvalidArgument, "0 realizations"));
  options = {};
  options.mcts.depth = 0;
  EXPECT_THAT(options.Validate(), StatusIs(StatusCode::kInvalidArgument, "mcts depth: 0"));
}

TEST(IjrrUtiasTest, ADataSetThatIsNotThereIsAnError) {
  IjrrUtiasOptions options;
  options.data = "/nowhere";
  options.datasets = {4};
  EXPECT_THAT(RunIjrrUtias(options, {}).status(),
              StatusIs(StatusCode::kNotFound, "/nowhere/MRCLAM_Dataset4"));
  options.data = RecordedData();
  if (options.data.empty()) GTEST_SKIP() << kNoRecordedData;
  options.datasets = {1, 99};
  EXPECT_THAT(RunIjrrUtias(options, {}).status(),
              StatusIs(StatusCode::kNotFound, "MRCLAM_Dataset99"));
}

// Runs the experiment as a command; its text goes to `out`, errors and all.
int RunCommand(std::vector<std::string> arguments, std::string* out) {
  Application application("shiftmap-experiment", "test");
  AddExperiments(&application);
  std::ostringstream text;
  arguments.insert(arguments.begin(), "ijrr-utias");
  const ExitCode code = application.Run(arguments, &text, &text);
  *out = text.str();
  return static_cast<int>(code);
}

TEST(IjrrUtiasCommand, ADataSetThatIsNotThereIsNotFound) {
  const testing::TempDir dir;
  std::string out;
  EXPECT_EQ(
      RunCommand({"--data", dir.path(), "--output", dir.File("out"), "--datasets", "4"}, &out),
      static_cast<int>(ExitCode::kNotFound));
  EXPECT_THAT(out, ::testing::HasSubstr("MRCLAM_Dataset4': no such folder"));
  EXPECT_EQ(std::count(out.begin(), out.end(), '\n'), 1) << out;
}

TEST(IjrrUtiasCommand, GivesStandardErrorsAndDrawsTheDisplacementOfThePaper) {
  const std::string data = RecordedData();
  if (data.empty()) GTEST_SKIP() << kNoRecordedData;
  const testing::TempDir dir;
  std::string out;
  ASSERT_EQ(RunCommand({"--data",
                        data,
                        "--output",
                        dir.File("out"),
                        "--datasets",
                        "2",
                        "--deltas",
                        "1",
                        "2.1",
                        "--methods",
                        "nohyp",
                        "mcts-40s",
                        "--depth",
                        "5",
                        "--iterations",
                        "20",
                        "--realizations",
                        "2",
                        "--threads",
                        "2",
                        "--quiet",
                        "--json"},
                       &out),
            0)
      << out;
  const Json document = Json::parse(out);
  ASSERT_EQ(document["rows"].size(), 4u);
  for (const Json& row : document["rows"]) {
    const bool random = row["method"] == "mcts-40s";
    EXPECT_EQ(row["realizations"], random ? 2 : 1);
    EXPECT_EQ(row["pose_rmse_se_m"].is_number(), random);
    EXPECT_EQ(row["landmark_rmse_se_m"].is_number(), random);
  }
  EXPECT_EQ(document["options"]["mcts"]["iterations"], 20);
  EXPECT_THAT(testing::ReadFile(dir.File("out/ijrr-utias-set2-robot1-paths.svg")),
              ::testing::HasSubstr("paths at 2.1 m"));
}

TEST(IjrrUtiasCommand, PrintsTheTimesOfTableOne) {
  const std::string data = RecordedData();
  if (data.empty()) GTEST_SKIP() << kNoRecordedData;
  const testing::TempDir dir;
  std::string out;
  ASSERT_EQ(RunCommand({"--data",
                        data,
                        "--output",
                        dir.File("out"),
                        "--datasets",
                        "3",
                        "--deltas",
                        "1",
                        "--methods",
                        "nohyp",
                        "em",
                        "--quiet"},
                       &out),
            0)
      << out;
  EXPECT_THAT(out, ::testing::ContainsRegex("method +dataset +mean_cpu_s +frames_per_s\n"));
  EXPECT_THAT(out, ::testing::ContainsRegex("\nnohyp +3 +[0-9.]+ +[0-9.]+\n"));
}

// The mean over realizations is that of runs with the seeds one after the other.
TEST(IjrrUtiasTest, ARealizationIsARunWithASeedOfItsOwn) {
  IjrrUtiasOptions options;
  options.data = RecordedData();
  if (options.data.empty()) GTEST_SKIP() << kNoRecordedData;
  options.datasets = {2};
  options.deltas_m = {0.6};
  options.methods = {"mcts-40s"};
  options.mcts.iterations = 5;
  options.protocol.duration_s = 100.0;
  std::vector<double> single;
  for (options.seed = 4; options.seed < 7; ++options.seed) {
    const StatusOr<IjrrUtiasResult> result = RunIjrrUtias(options, {});
    ASSERT_THAT(result, IsOk());
    single.push_back(result->rows.at(0).pose_rmse_m);
    EXPECT_TRUE(std::isnan(result->rows.at(0).pose_rmse_se_m));
  }
  options.seed = 4;
  options.realizations = 3;
  const StatusOr<IjrrUtiasResult> result = RunIjrrUtias(options, {});
  ASSERT_THAT(result, IsOk());
  const double mean = (single[0] + single[1] + single[2]) / 3.0;
  double squares = 0.0;
  for (const double rmse_m : single) squares += (rmse_m - mean) * (rmse_m - mean);
  EXPECT_GT(squares, 0.0);
  EXPECT_NEAR(result->rows.at(0).pose_rmse_m, mean, 1e-12);
  EXPECT_NEAR(result->rows.at(0).pose_rmse_se_m, std::sqrt(squares / 2.0 / 3.0), 1e-12);
}

// Figure 9, calibrated.
TEST(IjrrUtiasTest, FigureNineIsAsMeasured) {
  struct Expected {
    int dataset;
    double delta_m;
    const char* method;
    double pose_rmse_m;
    double landmark_rmse_m;
  };
  const std::vector<Expected> figure = {
      {1, 1.0, "ours", 0.057, 0.013},        {1, 1.0, "incremental", 0.046, 0.018},
      {1, 1.0, "nn", 0.209, 0.435},          {1, 1.0, "nohyp", 0.483, 0.350},
      {2, 0.6, "incremental", 0.050, 0.032}, {2, 0.6, "nn", 1.067, 1.341},
      {2, 0.6, "em", 0.495, 0.649},          {2, 0.6, "em-recursive", 0.647, 0.844},
      {2, 0.6, "viterbi", 0.647, 0.844},     {2, 0.6, "nohyp", 0.280, 0.229},
      {2, 1.0, "ours", 0.044, 0.021},        {2, 1.0, "incremental", 0.050, 0.032},
      {2, 1.0, "nn", 1.552, 1.996},          {2, 1.0, "em", 0.051, 0.036},
      {2, 1.0, "viterbi", 0.051, 0.034},     {2, 1.0, "nohyp", 0.468, 0.386},
      {3, 0.6, "nn", 0.126, 0.164},          {3, 0.6, "em", 0.135, 0.144},
      {3, 0.6, "mcts", 0.133, 0.143},        {3, 0.6, "nohyp", 0.172, 0.252},
      {3, 1.0, "ours", 0.104, 0.036},        {3, 1.0, "incremental", 0.089, 0.051},
      {3, 1.0, "em", 0.089, 0.051},          {3, 1.0, "nohyp", 0.254, 0.431},
  };
  IjrrUtiasOptions options;
  options.data = RecordedData();
  if (options.data.empty()) GTEST_SKIP() << kNoRecordedData;
  options.deltas_m = {0.6, 1.0};
  options.methods = {"ours", "incremental", "nn", "em", "em-recursive", "nohyp", "viterbi"};
  StatusOr<IjrrUtiasResult> result = RunIjrrUtias(options, {});
  ASSERT_THAT(result, IsOk());
  // On the other sets the search takes ten times as long.
  options.datasets = {3};
  options.deltas_m = {0.6};
  options.methods = {"mcts"};
  const StatusOr<IjrrUtiasResult> search = RunIjrrUtias(options, {});
  ASSERT_THAT(search, IsOk());
  result->rows.insert(result->rows.end(), search->rows.begin(), search->rows.end());
  for (const Expected& expected : figure) {
    const auto row =
        std::find_if(result->rows.begin(), result->rows.end(), [&](const IjrrUtiasRow& candidate) {
          return candidate.dataset == expected.dataset && candidate.delta_m == expected.delta_m &&
                 candidate.method == expected.method;
        });
    ASSERT_NE(row, result->rows.end());
    SCOPED_TRACE(
        fmt::format("set {} at {} m: {}", expected.dataset, expected.delta_m, expected.method));
    EXPECT_NEAR(row->pose_rmse_m, expected.pose_rmse_m, 0.002);
    EXPECT_NEAR(row->landmark_rmse_m, expected.landmark_rmse_m, 0.002);
  }
}

// Figure 10: with many modes em is as bad at any displacement.
TEST(IjrrUtiasTest, FigureTenIsAsMeasured) {
  IjrrUtiasOptions options;
  options.data = RecordedData();
  if (options.data.empty()) GTEST_SKIP() << kNoRecordedData;
  options.datasets = {1};
  options.deltas_m = {1.0, 2.5};
  options.methods = {"em", "em-printed"};
  const StatusOr<IjrrUtiasResult> few = RunIjrrUtias(options, {});
  ASSERT_THAT(few, IsOk());
  options.more_modes = true;
  const StatusOr<IjrrUtiasResult> many = RunIjrrUtias(options, {});
  ASSERT_THAT(many, IsOk());
  ASSERT_EQ(many->rows.size(), 4u);
  for (std::size_t i = 0; i < many->rows.size(); ++i) {
    SCOPED_TRACE(fmt::format("{} at {} m", many->rows[i].method, many->rows[i].delta_m));
    const bool printed = many->rows[i].method == "em-printed";
    EXPECT_NEAR(many->rows[i].pose_rmse_m, printed ? 1.138 : 0.339, 0.002);
    EXPECT_GE(many->rows[i].created, few->rows[i].created + 5.0);
  }
}

TEST(IjrrUtiasTest, MapperIsNearTheOracleOnRecordedData) {
  IjrrUtiasOptions options;
  options.data = RecordedData();
  if (options.data.empty()) GTEST_SKIP() << kNoRecordedData;
  options.datasets = {1};
  options.deltas_m = {0.0, 1.0, 2.5};
  options.methods = {"ours", "oracle"};
  const StatusOr<IjrrUtiasResult> result = RunIjrrUtias(options, {});
  ASSERT_THAT(result, IsOk());
  ASSERT_EQ(result->rows.size(), 6u);
  for (std::size_t i = 0; i < result->rows.size(); i += 2) {
    const IjrrUtiasRow& ours = result->rows[i];
    const IjrrUtiasRow& oracle = result->rows[i + 1];
    SCOPED_TRACE(ours.delta_m);
    const auto bound = [](double rmse_m) { return std::max(1.15 * rmse_m, rmse_m + 0.02); };
    EXPECT_LE(ours.pose_rmse_m, bound(oracle.pose_rmse_m));
    EXPECT_LE(ours.landmark_rmse_m, bound(oracle.landmark_rmse_m));
  }
}

TEST(IjrrUtiasTest, TheTruthIsTheExplanationWithWhatMoved) {
  UtiasCase data;
  const Signature a("a");
  const Signature b("b");
  const Signature c("c");
  data.moved = {a, b};
  UtiasEstimate estimate;
  EXPECT_EQ(ProbabilityOfTruth(data, estimate), std::nullopt);
  AmbiguousChange change;
  change.explanations = {{{b}, {a, c}, 0.5}, {{c}, {a}, 0.3}, {{a, b}, {c}, 0.2}};
  estimate.ambiguous_changes = {change};
  EXPECT_EQ(ProbabilityOfTruth(data, estimate), 0.3);  // b was not seen.
  change.explanations.erase(change.explanations.begin() + 1);
  estimate.ambiguous_changes = {change};
  EXPECT_EQ(ProbabilityOfTruth(data, estimate), 0.0);
}

// Four landmarks that moved together, or four others the other way.
TEST(IjrrUtiasTest, WhatRecordedDataDoNotDecideIsSaid) {
  IjrrUtiasOptions options;
  options.data = RecordedData();
  if (options.data.empty()) GTEST_SKIP() << kNoRecordedData;
  options.datasets = {6};
  options.robots = {2};
  options.starts_s = {680.0};
  options.deltas_m = {0.3, 0.6, 1.0};
  options.methods = {"ours", "oracle"};
  const StatusOr<IjrrUtiasResult> result = RunIjrrUtias(options, {});
  ASSERT_THAT(result, IsOk());
  ASSERT_EQ(result->rows.size(), 6u);
  for (std::size_t i = 0; i < 6; i += 2) {
    const IjrrUtiasRow& ours = result->rows[i];
    SCOPED_TRACE(ours.delta_m);
    EXPECT_EQ(ours.waits, ours.delta_m > 0.4);  // As far apart as two frames are.
    EXPECT_GT(ours.truth_probability.value_or(0.0), 0.05);
    EXPECT_FALSE(result->rows[i + 1].truth_probability.has_value());
  }
}

// Without hypotheses the frames end in the static solve; with them the moved landmarks do no harm.
TEST(IjrrUtiasTest, FrameByFrameIsNearTheBatchOnRecordedData) {
  IjrrUtiasOptions options;
  options.data = RecordedData();
  if (options.data.empty()) GTEST_SKIP() << kNoRecordedData;
  options.datasets = {1};
  options.deltas_m = {0.0, 1.0};
  options.methods = {"static", "nohyp", "incremental-40s"};
  const StatusOr<IjrrUtiasResult> result = RunIjrrUtias(options, {});
  ASSERT_THAT(result, IsOk());
  ASSERT_EQ(result->rows.size(), 6u);
  const auto row = [&](std::size_t delta, const std::string& method) {
    for (std::size_t i = 3 * delta; i < 3 * delta + 3; ++i) {
      if (result->rows[i].method == method) return result->rows[i];
    }
    return IjrrUtiasRow();
  };
  EXPECT_NEAR(row(0, "nohyp").pose_rmse_m, row(0, "static").pose_rmse_m, 0.01);
  EXPECT_NEAR(row(0, "nohyp").landmark_rmse_m, row(0, "static").landmark_rmse_m, 0.01);
  EXPECT_EQ(row(0, "incremental-40s").created, 0);
  EXPECT_EQ(row(1, "incremental-40s").created, 4);
  EXPECT_LT(row(1, "incremental-40s").pose_rmse_m, 1.3 * row(0, "static").pose_rmse_m);
  EXPECT_GT(row(1, "nohyp").pose_rmse_m, 5.0 * row(0, "static").pose_rmse_m);
}

}  // namespace
}  // namespace shiftmap
