// SPDX-License-Identifier: Apache-2.0
//
// Real robots among landmarks that were moved: UTIAS MRCLAM data sets 1 and 2 share one frame, and
// 12 of their 15 landmarks stand elsewhere in the second. Skipped where the data is absent
// (SHIFTMAP_DATA).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "localizer/localizer.h"
#include "mapper/mapper.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/map_store.h"
#include "mapstore/run/trajectory.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tools/convert/utias.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::TempDir;

using Places = std::map<Signature, Eigen::Vector2d>;

constexpr double kSurveyToleranceM = 0.15;
constexpr double kPoseToleranceM = 0.25;
constexpr int kLandmarks = 15;
constexpr int kMoved = 12;

std::string DatasetDir(int dataset) {
  const char* data = std::getenv("SHIFTMAP_DATA");
  return std::string(data == nullptr ? "" : data) + "/utias/MRCLAM_Dataset" +
         std::to_string(dataset);
}

Run LoadRun(int dataset, int robot) {
  UtiasOptions options;
  options.dataset_dir = DatasetDir(dataset);
  options.robot = robot;
  return ReadUtias(options).value().run;
}

MapperInput Input(int dataset, int robot) {
  const std::string name = "set" + std::to_string(dataset) + "_robot" + std::to_string(robot);
  return {name, name, LoadRun(dataset, robot)};
}

// Built once: every test looks at the same map.
const MapperResult& TwoRunMap() {
  static const MapperResult result = BuildMap({Input(1, 1), Input(2, 1)}, std::nullopt, {}).value();
  return result;
}

// The surveyed places of both layouts and the transform of the map to their frame, by all modes,
// each matched to the nearest of its landmark's places under an alignment found by consensus.
class Survey {
 public:
  Survey()
      : layouts_{ReadUtiasLandmarks(DatasetDir(1)).value(),
                 ReadUtiasLandmarks(DatasetDir(2)).value()} {
    const std::vector<LandmarkGroup>& groups = TwoRunMap().content.groups;
    std::vector<AlignmentPoint> reference;
    std::vector<AlignmentPoint> modes;
    for (std::size_t g = 0; g < groups.size(); ++g) {
      for (const Places& layout : layouts_) {
        reference.push_back(
            {GroupIndex(g), layout.at(groups[g].signature), Eigen::Matrix2d::Zero()});
      }
      for (const Mode& mode : groups[g].modes) {
        modes.push_back({GroupIndex(g), mode.p_map_landmark, mode.cov_p_map_landmark});
      }
    }
    T_survey_map_ = AlignByConsensus(reference, modes, {}).value().T_reference_other;
    std::vector<PointPair> pairs;
    for (const LandmarkGroup& group : groups) {
      for (const Mode& mode : group.modes) {
        pairs.push_back({Nearest(group.signature, mode.p_map_landmark), mode.p_map_landmark});
      }
    }
    T_survey_map_ = AlignRigid2d(pairs).value();
  }

  const Se2& T_survey_map() const { return T_survey_map_; }

  double Error(const Signature& signature, const Eigen::Vector2d& p_map) const {
    return (Nearest(signature, p_map) - T_survey_map_ * p_map).norm();
  }

  // The number of the mode that holds in a data set.
  ModeNumber TrueMode(const LandmarkGroup& group, int dataset) const {
    const Eigen::Vector2d& place =
        layouts_[static_cast<std::size_t>(dataset - 1)].at(group.signature);
    const auto nearest =
        std::min_element(group.modes.begin(), group.modes.end(), [&](const Mode& a, const Mode& b) {
          return (T_survey_map_ * a.p_map_landmark - place).norm() <
                 (T_survey_map_ * b.p_map_landmark - place).norm();
        });
    return nearest->number;
  }

 private:
  Eigen::Vector2d Nearest(const Signature& signature, const Eigen::Vector2d& p_map) const {
    const Eigen::Vector2d p_survey = T_survey_map_ * p_map;
    const Eigen::Vector2d& first = layouts_[0].at(signature);
    const Eigen::Vector2d& second = layouts_[1].at(signature);
    return (first - p_survey).norm() < (second - p_survey).norm() ? first : second;
  }

  std::vector<Places> layouts_;
  Se2 T_survey_map_;
};

// How long each landmark is seen, over visits of scans at most two seconds apart: the longest.
std::map<Signature, double> LongestViews(const Run& run) {
  std::map<Signature, std::pair<Stamp, Stamp>> open;
  std::map<Signature, double> longest;
  for (const Scan& scan : run.scans) {
    for (const Observation& observation : scan.observations) {
      const auto [entry, added] = open.try_emplace(observation.signature, scan.stamp, scan.stamp);
      auto& [begin, end] = entry->second;
      if (scan.stamp - end > FromSeconds(2.0)) begin = scan.stamp;
      end = scan.stamp;
      double& best = longest[observation.signature];
      best = std::max(best, ToSeconds(end - begin));
    }
  }
  return longest;
}

struct ShiftResult {
  ShiftReport report;
  std::vector<StampedPose> trajectory;
};

ShiftResult Drive(const MapSnapshot& map, const Run& run) {
  Localizer localizer(map, {});
  ShiftResult result;
  for (const RunEvent& event : MergeEvents(run)) {
    EXPECT_THAT(localizer.Process(event), IsOk());
    for (const PoseEstimate& estimate : localizer.new_estimates()) {
      result.trajectory.push_back({estimate.stamp, estimate.pose.T_map_vehicle});
    }
  }
  localizer.Finish();
  result.report = localizer.Report();
  result.report.uuid = RandomUuid();
  result.report.vehicle = run.info.vehicle;
  result.report.software = "test";
  return result;
}

// Position RMSE against motion capture from the first decision on. [m]
double PoseRmse(const ShiftResult& shift, int dataset, const Se2& T_survey_map) {
  const std::vector<StampedPose> truth = ReadUtiasGroundtruth(DatasetDir(dataset), 2).value();
  double sum = 0.0;
  int count = 0;
  for (const StampedPose& estimate : shift.trajectory) {
    if (estimate.stamp < shift.report.decisions.front().stamp) continue;
    const std::optional<Se2> T_survey_vehicle =
        Interpolate(truth, estimate.stamp, FromSeconds(1.0));
    if (!T_survey_vehicle) continue;
    sum += ((T_survey_map * estimate.T_map_vehicle).translation() - T_survey_vehicle->translation())
               .squaredNorm();
    ++count;
  }
  EXPECT_GT(count, 1000);
  return std::sqrt(sum / count);
}

class UtiasTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(DatasetDir(1))) {
      GTEST_SKIP()
          << "no UTIAS data: set SHIFTMAP_DATA to the folder that holds utias/MRCLAM_Dataset1";
    }
  }
};

TEST_F(UtiasTest, TwoRunsOfTwoLayoutsGiveEveryPosition) {
  const std::vector<LandmarkGroup>& groups = TwoRunMap().content.groups;
  ASSERT_EQ(groups.size(), kLandmarks);
  const auto modes = [](std::size_t count) {
    return [count](const LandmarkGroup& group) { return group.modes.size() == count; };
  };
  EXPECT_EQ(std::count_if(groups.begin(), groups.end(), modes(2)), kMoved);
  EXPECT_EQ(std::count_if(groups.begin(), groups.end(), modes(1)), kLandmarks - kMoved);
  const Survey survey;
  double worst = 0.0;
  for (const LandmarkGroup& group : groups) {
    for (const Mode& mode : group.modes) {
      const double error = survey.Error(group.signature, mode.p_map_landmark);
      EXPECT_LT(error, kSurveyToleranceM)
          << group.signature.text() << " mode " << mode.number.value();
      worst = std::max(worst, error);
    }
  }
  RecordProperty("worst_mode_error_m", std::to_string(worst));
}

TEST_F(UtiasTest, SameMapWhateverTheOrderOfTheRuns) {
  const MapperResult swapped = BuildMap({Input(2, 1), Input(1, 1)}, std::nullopt, {}).value();
  EXPECT_EQ(ContentHash(swapped.content), ContentHash(TwoRunMap().content));
}

TEST_F(UtiasTest, AnotherRobotDecidesTheLayoutThatHoldsAndTheMapLearnsIt) {
  const TempDir dir;
  MapStore store =
      MapStore::Open(dir.path() + "/maps.db", MapStore::Access::kReadWriteCreate).value();
  Provenance provenance;
  provenance.tool = "test";
  // As if the two runs had been mapped the day before the shifts: what is newer decides.
  MapContent content = TwoRunMap().content;
  content.stamp = LoadRun(1, 2).odometry.front().stamp - FromSeconds(86400.0);
  ASSERT_THAT(store.Commit("utias", content, provenance, {}).status(), IsOk());
  const Survey survey;

  // The map's newest run is of layout 2, so that both shifts begin with the wrong layout on top.
  for (const int dataset : {1, 2}) {
    SCOPED_TRACE("data set " + std::to_string(dataset));
    const shiftmap::Run run = LoadRun(dataset, 2);
    const MapSnapshot map = store.LoadAt("utias").value();
    const ShiftResult shift = Drive(map, run);

    std::map<Signature, int> decided;
    for (const Decision& decision : shift.report.decisions) {
      const LandmarkGroup& group =
          map.groups()[static_cast<std::size_t>(map.GroupIndex(decision.signature))];
      EXPECT_EQ(decision.mode, survey.TrueMode(group, dataset)) << decision.signature.text();
      ++decided[decision.signature];
    }
    for (const auto& [signature, seconds] : LongestViews(run)) {
      if (seconds < 1.0) continue;
      EXPECT_GT(decided[signature], 0) << signature.text() << " seen for " << seconds << " s";
    }
    const double rmse = PoseRmse(shift, dataset, survey.T_survey_map());
    EXPECT_LT(rmse, kPoseToleranceM);
    RecordProperty("pose_rmse_m_set" + std::to_string(dataset), std::to_string(rmse));

    ASSERT_THAT(store.Return(shift.report).status(), IsOk());
    const MapSnapshot learned = store.LoadAt("utias").value();
    for (const LandmarkGroup& group : learned.groups()) {
      Eigen::Index top = 0;
      group.probabilities.maxCoeff(&top);
      EXPECT_EQ(group.NumberOf(static_cast<int>(top)), survey.TrueMode(group, dataset))
          << group.signature.text();
    }
  }
}

}  // namespace
}  // namespace shiftmap
