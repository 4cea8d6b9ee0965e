// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <string>
#include <variant>
#include <vector>

#include "localizer/localizer.h"
#include "proto/core/check.h"
#include "tools/experiment/localizer_states.h"

namespace shiftmap {
namespace {

// SHIFTMAP_LONG_TESTS: as many shifts as the claim of one in a hundred needs.
int ShiftsPerCause() { return std::getenv("SHIFTMAP_LONG_TESTS") != nullptr ? 200 : 12; }

// The least k with P(X > k) < `tail` for X ~ B(n, p).
std::int64_t BinomialBound(std::int64_t n, double p, double tail) {
  double term = std::pow(1.0 - p, static_cast<double>(n));
  double below = term;
  std::int64_t k = 0;
  while (1.0 - below >= tail && k < n) {
    term *= p / (1.0 - p) * static_cast<double>(n - k) / static_cast<double>(k + 1);
    below += term;
    ++k;
  }
  return k;
}

class StateConfusion : public testing::TestWithParam<int> {};

TEST_P(StateConfusion, LostAndUnknownChangeAreNotTakenForEachOther) {
  const auto cause = static_cast<ShiftCause>(GetParam());
  const CauseTally tally = TallyCause(cause, 20001, ShiftsPerCause(), 2, LocalizerOptions());
  std::string seeds;
  for (const std::uint64_t seed : tally.confused_seeds) seeds += " " + std::to_string(seed);
  // A rack and nothing else in view is as well explained by another pose.
  const bool rack = cause == ShiftCause::kRackMoved;
  const std::int64_t unexcused = tally.confused - (rack ? tally.pose_wrong : 0);
  EXPECT_LE(unexcused, BinomialBound(tally.shifts, rack ? 0.05 : 0.01, 1e-3)) << "seeds" << seeds;
  EXPECT_LE(tally.said_before, BinomialBound(tally.shifts, 0.01, 1e-3));
  EXPECT_LE(tally.shifts - tally.recovered, BinomialBound(tally.shifts, 0.02, 1e-3));

  // What the cause must lead to, where it must lead to something.
  const auto reported = [&](LocalizerState state) {
    return tally.reported[static_cast<std::size_t>(state)];
  };
  const std::int64_t most = tally.shifts - BinomialBound(tally.shifts, 0.05, 1e-3);
  if (cause == ShiftCause::kNothing) {
    EXPECT_GE(reported(LocalizerState::kTracking), most);
  }
  if (cause == ShiftCause::kModeChange) {
    EXPECT_GE(reported(LocalizerState::kModeChanged), most);
  }
  if (cause == ShiftCause::kMoved) {
    EXPECT_GE(reported(LocalizerState::kUnknownChange), most);
  }
  if (rack) {
    EXPECT_GE(reported(LocalizerState::kUnknownChange), tally.shifts / 2);
  }
  if (cause == ShiftCause::kKidnapped) {
    EXPECT_GE(reported(LocalizerState::kLost), most);
  }
  if (cause == ShiftCause::kDuplicate) {
    EXPECT_GE(tally.reported.back(), most);
  }
}

INSTANTIATE_TEST_SUITE_P(Causes,
                         StateConfusion,
                         testing::Range(0, static_cast<int>(kShiftCauses)),
                         [](const testing::TestParamInfo<int>& param) {
                           std::string name = ToString(static_cast<ShiftCause>(param.param));
                           std::replace(name.begin(), name.end(), ' ', '_');
                           return name;
                         });

// The quality at the end of a shift in which nothing is amiss but the stated noise.
double QualityOf(std::uint64_t seed, double stated_over_true_noise) {
  const CausedShift shift = DrawShift(ShiftCause::kNothing, seed);
  MapContent content = shift.content;
  content.calibration.sensor.sd_range_m *= stated_over_true_noise;
  content.calibration.sensor.sd_bearing_rad *= stated_over_true_noise;
  LocalizerOptions options;
  options.initial_pose = shift.start;
  Localizer localizer(MapSnapshot("area", VersionNumber(1), "hash", content), options);
  for (const RunEvent& event : shift.events) EXPECT_TRUE(localizer.Process(event).ok());
  return localizer.Estimate()->quality;
}

TEST(InnovationQualityOfShifts, IsLowWhereTheSensorIsWorseThanStated) {
  constexpr int kShifts = 12;
  int low = 0;
  for (int i = 0; i < kShifts; ++i) {
    low += QualityOf(31000 + static_cast<std::uint64_t>(i), 0.5) < 0.05;
  }
  EXPECT_GE(low, kShifts * 2 / 3);
}

TEST(InnovationQualityOfShifts, IsUniformWhereNothingIsAmiss) {
  constexpr int kShifts = 80;
  std::vector<double> qualities;
  for (int i = 0; i < kShifts; ++i) {
    qualities.push_back(QualityOf(30000 + static_cast<std::uint64_t>(i), 1.0));
  }
  std::sort(qualities.begin(), qualities.end());
  double distance = 0.0;
  for (std::size_t i = 0; i < qualities.size(); ++i) {
    const double below = static_cast<double>(i) / kShifts;
    const double above = static_cast<double>(i + 1) / kShifts;
    distance = std::max({distance, qualities[i] - below, above - qualities[i]});
  }
  // Kolmogorov-Smirnov, level 0.001.
  EXPECT_LT(distance, 1.95 / std::sqrt(static_cast<double>(kShifts)));
}

// How long poses were trusted, and of that how long with an error beyond a metre and five standard
// deviations.
struct Trust {
  double trusted_s = 0.0;
  double wrong_s = 0.0;
  double vaguest_m = 0.0;  // Standard deviation of the position.
};

void AddTrust(const CausedShift& shift, const std::vector<RunEvent>& events, Trust* trust) {
  std::map<Stamp, Se2> truth;
  auto pose = shift.T_map_vehicle.begin();
  for (const RunEvent& event : shift.events) {
    if (std::holds_alternative<Scan>(event)) truth[StampOf(event)] = *pose++;
  }
  LocalizerOptions options;
  options.initial_pose = shift.start;
  Localizer localizer(MapSnapshot("area", VersionNumber(1), "hash", shift.content), options);
  for (const RunEvent& event : events) {
    ASSERT_TRUE(localizer.Process(event).ok());
    if (!std::holds_alternative<Scan>(event) || localizer.state() == LocalizerState::kLost)
      continue;
    constexpr double kScanS = 0.25;
    const PoseWithCovariance stated = localizer.Estimate()->pose;
    const double sd_m = std::sqrt(stated.cov_T_map_vehicle.topLeftCorner<2, 2>().trace());
    const double error_m =
        (stated.T_map_vehicle.translation() - truth.at(StampOf(event)).translation()).norm();
    trust->trusted_s += kScanS;
    if (error_m > 1.0 && error_m > 5.0 * sd_m) trust->wrong_s += kScanS;
    trust->vaguest_m = std::max(trust->vaguest_m, sd_m);
  }
}

double SecondsIn(const RunEvent& event, const CausedShift& shift) {
  return ToSeconds(StampOf(event) - StampOf(shift.events.front()));
}

TEST(TrustOfShifts, ATurnRateThatIsMissingIsFoundOut) {
  constexpr int kShifts = 40;
  Trust trust;
  for (std::uint64_t seed = 8001; seed < 8001 + kShifts; ++seed) {
    const CausedShift shift = DrawShift(ShiftCause::kNothing, seed);
    std::vector<RunEvent> events = shift.events;
    for (RunEvent& event : events) {
      auto* sample = std::get_if<OdometrySample>(&event);
      if (sample != nullptr && SecondsIn(event, shift) > 25.0) sample->omega_radps = 0.0;
    }
    AddTrust(shift, events, &trust);
  }
  EXPECT_GT(trust.trusted_s, kShifts * 60.0);
  EXPECT_LT(trust.wrong_s, 0.003 * trust.trusted_s);
}

// From the beginning, or from some time on.
TEST(TrustOfShifts, ScansWithoutOdometryAreTrustedOnlyWhereTheyDetermineThePose) {
  constexpr int kShifts = 40;
  for (const double begin_s : {0.0, 25.0}) {
    Trust trust;
    for (std::uint64_t seed = 8101; seed < 8101 + kShifts; ++seed) {
      const CausedShift shift = DrawShift(ShiftCause::kNothing, seed);
      std::vector<RunEvent> events = shift.events;
      std::erase_if(events, [&](const RunEvent& event) {
        return std::holds_alternative<OdometrySample>(event) && SecondsIn(event, shift) >= begin_s;
      });
      AddTrust(shift, events, &trust);
    }
    EXPECT_GT(trust.trusted_s, kShifts * 60.0) << begin_s;
    EXPECT_LT(trust.wrong_s, 0.001 * trust.trusted_s) << begin_s;
  }
}

TEST(TrustOfShifts, APoseAsVagueAsAfterAGapIsNotTrusted) {
  Trust trust;
  for (std::uint64_t seed = 7001; seed <= 7060; ++seed) {
    const CausedShift shift = DrawShift(ShiftCause::kNothing, seed);
    std::vector<RunEvent> events = shift.events;
    std::erase_if(events, [&](const RunEvent& event) {
      return SecondsIn(event, shift) > 30.0 && SecondsIn(event, shift) < 60.0;
    });
    AddTrust(shift, events, &trust);
  }
  EXPECT_LT(trust.wrong_s, 0.001 * trust.trusted_s);
  // In no direction more than LocalizerOptions::max_position_sd_m.
  EXPECT_LE(trust.vaguest_m, std::sqrt(2.0) * LocalizerOptions().max_position_sd_m);
}

TEST(StatesOfShifts, EachChangeHasItsEvidence) {
  const CausedShift shift = DrawShift(ShiftCause::kKidnapped, 1);
  LocalizerOptions options;
  options.initial_pose = shift.start;
  Localizer localizer(MapSnapshot("area", VersionNumber(1), "hash", shift.content), options);
  for (const RunEvent& event : shift.events) ASSERT_TRUE(localizer.Process(event).ok());
  bool lost = false;
  bool found = false;
  for (const StateChange& change : localizer.state_changes()) {
    const PoseSupport& support = change.evidence.support;
    if (change.to == LocalizerState::kLost) {
      lost = true;
      EXPECT_GE(change.stamp, shift.cause);
      EXPECT_GE(support.failing, 3);
      EXPECT_GT(support.failing, support.agreeing);
    }
    if (change.from == LocalizerState::kLost && change.to == LocalizerState::kTracking) {
      found = true;
      EXPECT_GE(support.agreeing, support.failing);
    }
  }
  EXPECT_TRUE(lost);
  EXPECT_TRUE(found);
}

}  // namespace
}  // namespace shiftmap
