// SPDX-License-Identifier: Apache-2.0
//
// Shifts and maps of values that pass validation and that no vehicle has: nothing may abort, no
// estimate may be other than finite, and an ordinary drive afterwards is localized.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "localizer/hypothesis/hypothesis_view.h"
#include "localizer/localizer.h"
#include "mapstore/core/magnitude.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/shift_report_check.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap {
namespace {

constexpr double kYear = 365.25 * 86400.0;

// Draws that favour the ends of what validation lets through.
class Extremes {
 public:
  explicit Extremes(std::uint64_t seed) : random_(seed) {}

  double Uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  bool Chance(double probability) { return Uniform(0.0, 1.0) < probability; }

  // 10^low to 10^high, often one of the two.
  double Power(double low, double high) {
    if (Chance(0.2)) return std::pow(10.0, high);
    if (Chance(0.1)) return std::pow(10.0, low);
    return std::pow(10.0, Uniform(low, high));
  }
  double Signed(double low, double high) { return Power(low, high) * (Chance(0.5) ? 1.0 : -1.0); }

  Eigen::Matrix2d Covariance(double low, double high) {
    const Eigen::Vector2d sd(std::sqrt(Power(low, high)), std::sqrt(Power(low, high)));
    const double correlation = Chance(0.3) ? Signed(-16.0, 0.0) * 0.9999999 : 0.0;
    Eigen::Matrix2d cov = sd.cwiseAbs2().asDiagonal();
    cov(0, 1) = cov(1, 0) = correlation * sd.x() * sd.y();
    return cov;
  }

  Observation Landmark(const MapContent& content) {
    Observation observation;
    const auto group =
        static_cast<std::size_t>(Uniform(0.0, 1.5 * static_cast<double>(content.groups.size())));
    observation.signature = group < content.groups.size()
                                ? content.groups[group].signature
                                : Signature("unknown " + std::to_string(group));
    if (Chance(0.5)) {
      observation.z = {Power(-9.0, 9.0), Signed(-9.0, 9.0)};
    } else {
      observation.kind = Observation::Kind::kCartesian;
      observation.z = {Signed(-9.0, 9.0), Signed(-9.0, 9.0)};
    }
    if (Chance(0.3)) observation.cov_z = Covariance(-300.0, 18.0);
    if (Chance(0.3)) observation.cov_z = Covariance(-18.0, 18.0);
    if (!ValidateEvent(Scan{Stamp(), {observation}}).ok()) observation.cov_z.reset();
    return observation;
  }

  // What a shift becomes where a share of its items is replaced.
  std::vector<RunEvent> Spoil(std::vector<RunEvent> events,
                              const MapContent& content,
                              double share,
                              double gap_share) {
    double gaps_s = 0.0;
    for (RunEvent& event : events) {
      if (Chance(gap_share)) {
        const double gap_s = Power(-9.0, std::log10(88.0 * kYear));
        if (gaps_s + gap_s < 90.0 * kYear) gaps_s += gap_s;
      }
      if (auto* sample = std::get_if<OdometrySample>(&event)) {
        sample->stamp += FromSeconds(gaps_s);
        if (Chance(share)) sample->v_mps = Signed(-9.0, 9.0);
        if (Chance(share)) sample->omega_radps = Signed(-9.0, 9.0);
        continue;
      }
      Scan& scan = std::get<Scan>(event);
      scan.stamp += FromSeconds(gaps_s);
      for (Observation& observation : scan.observations) {
        if (Chance(share)) observation = Landmark(content);
      }
      while (Chance(0.5 * share)) scan.observations.push_back(Landmark(content));
    }
    return events;
  }

  std::mt19937_64& random() { return random_; }

 private:
  std::mt19937_64 random_;
};

void ExpectSound(const PoseWithCovariance& pose) {
  ASSERT_TRUE(pose.T_map_vehicle.translation().allFinite());
  ASSERT_TRUE(std::isfinite(pose.T_map_vehicle.yaw()));
  // Of the correlations: the variances of position and yaw may be 10¹³ apart.
  ASSERT_GT(pose.cov_T_map_vehicle.diagonal().minCoeff(), 0.0) << pose.cov_T_map_vehicle;
  const Eigen::Vector3d scale = pose.cov_T_map_vehicle.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::Matrix3d correlations =
      scale.asDiagonal() * pose.cov_T_map_vehicle * scale.asDiagonal();
  ASSERT_TRUE(IsSymmetricPositiveDefinite(correlations)) << pose.cov_T_map_vehicle;
}

void ExpectSound(const Localizer& localizer) {
  for (const PoseEstimate& estimate : localizer.new_estimates()) {
    ASSERT_NO_FATAL_FAILURE(ExpectSound(estimate.pose));
    ASSERT_TRUE(estimate.quality >= 0.0 && estimate.quality <= 1.0) << estimate.quality;
  }
}

void ExpectSoundInFull(const Localizer& localizer) {
  const LocalizerStatistics statistics = localizer.Statistics();
  ASSERT_TRUE(std::isfinite(statistics.nis_sum) && statistics.nis_sum >= 0.0);
  ASSERT_TRUE(statistics.dropped_mass_max >= 0.0 && statistics.dropped_mass_max <= 1.0);
  const std::size_t groups = localizer.snapshot().groups().size();
  for (std::size_t group = 0; group < groups; ++group) {
    const Eigen::VectorXd p = localizer.Probabilities(static_cast<int>(group));
    ASSERT_TRUE(p.allFinite() && p.minCoeff() >= 0.0) << p.transpose();
    ASSERT_NEAR(p.sum(), 1.0, 1e-6);
  }
  if (localizer.hypotheses() == nullptr) return;
  const HypothesisView view = ViewHypotheses(*localizer.hypotheses(), localizer.snapshot());
  for (const HypothesisView::Node& node : view.nodes) ASSERT_TRUE(std::isfinite(node.probability));
}

// Runs events through; items later than D are refused, as in a live stream.
void Feed(const std::vector<RunEvent>& events, Localizer* localizer) {
  for (std::size_t i = 0; i < events.size(); ++i) {
    localizer->Process(events[i]).IgnoreError();
    ASSERT_NO_FATAL_FAILURE(ExpectSound(*localizer)) << "item " << i;
    if (i % 100 == 0) {
      ASSERT_NO_FATAL_FAILURE(ExpectSoundInFull(*localizer)) << "item " << i;
    }
  }
}

LimitOptions NoLimits() {
  LimitOptions limits;
  limits.max_range_m = kMaxMagnitude;
  limits.max_speed_mps = kMaxMagnitude;
  limits.max_yaw_rate_radps = kMaxMagnitude;
  return limits;
}

LocalizerOptions OptionsAt(const Se2& start) {
  LocalizerOptions options;
  options.initial_pose =
      PoseWithCovariance{start, Eigen::Vector3d(0.04, 0.04, 0.0025).asDiagonal()};
  return options;
}

// What a report of it leaves out may be much, but it is valid.
void ExpectValidReport(const Localizer& localizer) {
  ShiftReport report = localizer.Report();
  report.uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
  report.vehicle = "truck";
  report.area = "hall";
  report.version = VersionNumber(1);
  report.content_hash = std::string(64, 'a');
  report.software = "test";
  LeaveOutInvalid(&report);
  EXPECT_THAT(ValidateShiftReport(report), testing::IsOk());
}

struct ExtremesCase {
  std::string name;
  double share = 0.0;
  double gap_share = 0.0;
  double max_delay_s = 0.0;
  bool given_start = false;
  bool limited = false;  // By the limits of vehicles and sensors.
};

class LocalizerExtremes : public ::testing::TestWithParam<ExtremesCase> {};

TEST_P(LocalizerExtremes, NothingBreaksAndAnOrdinaryDriveAfterwardsIsLocalized) {
  const ExtremesCase& param = GetParam();
  const MapContent content = MakeTwoModeMap(12, 12.0, 2);
  const std::vector<Eigen::Vector2d> truth =
      PositionsOf(content, std::vector<int>(content.groups.size(), 1));
  const std::uint64_t first = testing::TestSeed(1);
  for (std::uint64_t seed = first; seed < first + 25; ++seed) {
    SCOPED_TRACE(seed);
    Extremes extremes(seed);
    SimulationOptions simulation;
    simulation.seed = seed;
    simulation.duration_s = 30.0;
    LocalizerOptions options = param.given_start ? OptionsAt(Se2()) : LocalizerOptions();
    options.max_delay_s = param.max_delay_s;
    options.hypotheses.max_leaves = 8;
    if (!param.limited) options.limits = NoLimits();
    Localizer localizer(Snapshot(content), options);
    const std::vector<RunEvent> spoiled =
        extremes.Spoil(MergeEvents(Simulate(content, truth, simulation).run),
                       content,
                       param.share,
                       param.gap_share);
    ASSERT_NO_FATAL_FAILURE(Feed(spoiled, &localizer));

    simulation.duration_s = 60.0;
    SimulatedRun ordinary = Simulate(content, truth, simulation);
    const Duration later = StampOf(spoiled.back()) + std::chrono::seconds(60) - Stamp();
    for (OdometrySample& sample : ordinary.run.odometry) sample.stamp += later;
    for (Scan& scan : ordinary.run.scans) scan.stamp += later;
    ASSERT_NO_FATAL_FAILURE(Feed(MergeEvents(ordinary.run), &localizer));
    localizer.Flush();
    ASSERT_NO_FATAL_FAILURE(ExpectSoundInFull(localizer));
    const auto estimate = localizer.Estimate();
    ASSERT_TRUE(estimate);
    EXPECT_NE(localizer.state(), LocalizerState::kLost);
    EXPECT_LT(
        (estimate->pose.T_map_vehicle.translation() - ordinary.T_map_vehicle.back().translation())
            .norm(),
        0.5);
    localizer.Finish();
    ASSERT_NO_FATAL_FAILURE(ExpectSoundInFull(localizer));
    ASSERT_NO_FATAL_FAILURE(ExpectValidReport(localizer));
  }
}

INSTANTIATE_TEST_SUITE_P(Shares,
                         LocalizerExtremes,
                         ::testing::Values(ExtremesCase{"Few", 0.01, 0.0, 0.0, true},
                                           ExtremesCase{"Many", 0.3, 0.0, 0.0, true},
                                           ExtremesCase{"All", 1.0, 0.0, 0.0, true},
                                           ExtremesCase{"FewWithGaps", 0.01, 0.01, 0.0, true},
                                           ExtremesCase{"ManyWithGapsLate", 0.1, 0.01, 0.2, false},
                                           ExtremesCase{"Limited", 0.1, 0.01, 0.2, true, true}),
                         [](const auto& each) { return each.param.name; });

// Content that ValidateMapContent() takes and nobody surveyed.
MapContent ExtremeMap(Extremes* extremes) {
  MapContent content = MakeTwoModeMap(8, 12.0, 2);
  std::vector<Eigen::Matrix2d> diagonal;
  for (LandmarkGroup& group : content.groups) {
    if (extremes->Chance(0.3)) {
      group.chain = ModeChain::Uniform(2, extremes->Power(-300.0, 9.0));
    }
    for (Mode& mode : group.modes) {
      if (extremes->Chance(0.2)) {
        mode.p_map_landmark = {extremes->Signed(-9.0, 9.0), extremes->Signed(-9.0, 9.0)};
      }
      if (extremes->Chance(0.3)) {
        const Eigen::Matrix2d cov = extremes->Covariance(-18.0, 18.0);
        if (IsSymmetricPositiveDefinite(cov)) mode.cov_p_map_landmark = cov;
      }
      diagonal.push_back(mode.cov_p_map_landmark);
    }
  }
  std::vector<JointCovariance::CrossBlock> cross;
  for (int row = 0; row + 1 < static_cast<int>(diagonal.size()); ++row) {
    if (extremes->Chance(0.5)) continue;
    cross.push_back({row, row + 1, extremes->Covariance(-18.0, 18.0)});
  }
  content.covariance = JointCovariance(std::move(diagonal), std::move(cross));
  for (double* value : CalibrationValues(&content.calibration)) {
    if (!extremes->Chance(0.1)) continue;
    const double before = std::exchange(*value, extremes->Power(-30.0, 9.0));
    if (!ValidateCalibration(content.calibration).ok()) *value = before;
  }
  return content;
}

TEST(LocalizerExtremesOfMaps, NothingBreaks) {
  const std::uint64_t first = testing::TestSeed(1);
  for (std::uint64_t seed = first; seed < first + 60; ++seed) {
    SCOPED_TRACE(seed);
    Extremes extremes(seed);
    const MapContent content = ExtremeMap(&extremes);
    ASSERT_THAT(ValidateMapContent(content), testing::IsOk());
    const MapContent usual = MakeTwoModeMap(8, 12.0, 2);
    SimulationOptions simulation;
    simulation.seed = seed;
    simulation.duration_s = 20.0;
    LocalizerOptions options = extremes.Chance(0.7) ? OptionsAt(Se2()) : LocalizerOptions();
    options.limits = NoLimits();
    Localizer localizer(Snapshot(content), options);
    const std::vector<Eigen::Vector2d> truth =
        PositionsOf(usual, std::vector<int>(usual.groups.size(), 1));
    ASSERT_NO_FATAL_FAILURE(Feed(
        extremes.Spoil(MergeEvents(Simulate(usual, truth, simulation).run), usual, 0.02, 0.001),
        &localizer));
    localizer.Finish();
    ASSERT_NO_FATAL_FAILURE(ExpectSoundInFull(localizer));
    ASSERT_NO_FATAL_FAILURE(ExpectValidReport(localizer));
  }
}

TEST(LocalizerMemory, KeepsABoundedNumberOfUnknownPlaces) {
  LocalizerOptions options = OptionsAt(Se2());
  options.max_places = 1000;
  Localizer localizer(Snapshot(MakeTwoModeMap(12, 12.0, 2)), options);
  constexpr int kScans = 20;
  constexpr int kSignatures = 20'000;
  for (int i = 0; i < kScans; ++i) {
    Scan scan{StampFromSeconds(1000.0 + 0.01 * i), {}};
    for (int k = 0; k < kSignatures; ++k) {
      Observation observation;
      observation.signature = Signature(std::to_string(i) + "/" + std::to_string(k));
      observation.z = {5.0, 0.0};
      scan.observations.push_back(observation);
    }
    ASSERT_THAT(localizer.Process(scan), testing::IsOk());
  }
  const LocalizerStatistics statistics = localizer.Statistics();
  EXPECT_EQ(localizer.Sightings().size(), 1000U);
  EXPECT_GT(statistics.excess_observations, 300'000);
  EXPECT_EQ(statistics.excess_observations + statistics.unknown_signatures, kScans * kSignatures);
  EXPECT_EQ(statistics.excess_places + 1000, statistics.unknown_signatures);
}

}  // namespace
}  // namespace shiftmap
