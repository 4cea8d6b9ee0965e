// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/missed_visits.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <set>

#include "localizer/models/detection_model.h"
#include "mapper/mapper.h"
#include "mapper/run_maps/single_run.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

using testing::IsOk;

constexpr int kRuns = 6;

// Landmarks that stand still, seen by a mediocre detector.
OpenWorldOptions StillWorld(std::uint64_t seed) {
  OpenWorldOptions options = testing::SmallWorld(seed);
  options.modes_per_group = 1;
  options.runs = kRuns;
  options.duration_s = 120.0;
  options.sensor.detection_probability = 0.5;
  return options;
}

void Remove(const Signature& signature, Run* run) {
  for (Scan& scan : run->scans) {
    std::erase_if(scan.observations,
                  [&](const Observation& seen) { return seen.signature == signature; });
  }
}

// Scans of a run in which a place is well in view.
int ScansInView(const SimulatedRun& run,
                const Eigen::Vector2d& place,
                const SensorCalibration& sensor) {
  int count = 0;
  auto pose = run.truth.begin();
  for (const Scan& scan : run.run.scans) {
    pose = std::find_if(
        pose, run.truth.end(), [&](const StampedPose& at) { return at.stamp >= scan.stamp; });
    if (pose == run.truth.end()) break;
    const bool others = !scan.observations.empty();
    count += others && WellInView(pose->T_map_vehicle.Inverse() * place, SectorOf(sensor)) ? 1 : 0;
  }
  return count;
}

double ProbabilityOfAbsent(const MapContent& content, const Signature& signature) {
  for (const LandmarkGroup& group : content.groups) {
    if (group.signature == signature) return group.probabilities[0];
  }
  return -1.0;
}

// The map of all runs at once, or of one night after the other.
MapContent Build(const SimulatedWorld& world, bool nightly) {
  std::optional<MapContent> prior;
  std::vector<MapperInput> inputs = testing::Inputs(world);
  std::vector<std::vector<MapperInput>> nights;
  if (nightly) {
    for (MapperInput& input : inputs) nights.push_back({std::move(input)});
  } else {
    nights.push_back(std::move(inputs));
  }
  for (std::vector<MapperInput>& night : nights) {
    const StatusOr<MapperResult> result = BuildMap(std::move(night), prior, {});
    EXPECT_THAT(result, IsOk());
    prior = result->content;
  }
  return *prior;
}

TEST(MissedVisits, ALandmarkThatIsTakenAwayBeforeTheLastRunIsAbsentAfterIt) {
  int removed = 0;
  int standing = 0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const OpenWorldOptions options = StillWorld(seed);
    SimulatedWorld world = testing::Simulate(options);
    std::set<Signature> gone;
    for (int i = 0; i < 3; ++i)
      gone.insert(world.groups[static_cast<std::size_t>(4 * i)].signature);
    for (const Signature& signature : gone) Remove(signature, &world.runs.back().run);
    for (const bool nightly : {false, true}) {
      const MapContent content = Build(world, nightly);
      for (const SimulatedGroup& group : world.groups) {
        const int in_view = ScansInView(world.runs.back(), group.modes[0], options.sensor);
        const double absent = ProbabilityOfAbsent(content, group.signature);
        if (absent < 0.0) continue;
        if (!gone.contains(group.signature)) {
          EXPECT_LT(absent, 0.05) << seed << " " << group.signature.text() << " " << nightly;
          ++standing;
        } else if (in_view >= 15) {
          EXPECT_GT(absent, 0.8) << seed << " " << group.signature.text() << " " << nightly
                                 << " in view " << in_view;
          ++removed;
        }
      }
    }
  }
  EXPECT_GE(removed, 12);
  EXPECT_GE(standing, 60);
}

// What a run that sees nothing of a landmark says against its mode, by signature.
std::map<Signature, double> SilenceOf(const MappedRun& run) {
  std::map<Signature, double> silence;
  for (const VisitEvidence& visit : run.evidence) {
    if (visit.observations == 0) silence[visit.signature] += visit.modes[1].log_likelihood;
  }
  return silence;
}

// The oracle is a build of all runs at once. A build of the last run alone on the map of the others
// needs what these saw.
TEST(MissedVisits, WeighWithWhatEarlierRunsSaw) {
  double without_memory = 0.0;
  double with_memory = 0.0;
  int landmarks = 0;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    SimulatedWorld world = testing::Simulate(StillWorld(seed));
    for (std::size_t g : {0U, 4U, 8U}) Remove(world.groups[g].signature, &world.runs.back().run);
    std::vector<MapperInput> inputs = testing::Inputs(world);
    const std::map<Signature, double> expected = SilenceOf(BuildMap(inputs, {}, {})->runs.back());
    const std::vector<MapperInput> last = {inputs.back()};
    inputs.pop_back();
    const StatusOr<MapperResult> before = BuildMap(inputs, {}, {});
    MapperOptions options;
    const StatusOr<MapperResult> forgetful = BuildMap(last, before->content, options);
    for (const MappedRun& run : before->runs) {
      options.visibility.insert(
          options.visibility.end(), run.visibility.begin(), run.visibility.end());
    }
    const StatusOr<MapperResult> night = BuildMap(last, before->content, options);
    ASSERT_THAT(night, IsOk());
    const std::map<Signature, double> remembered = SilenceOf(night->runs.back());
    const std::map<Signature, double> forgotten = SilenceOf(forgetful->runs.back());
    for (std::size_t g : {0U, 4U, 8U}) {
      const Signature& signature = world.groups[g].signature;
      if (!expected.contains(signature) || !remembered.contains(signature)) continue;
      with_memory += std::abs(remembered.at(signature) - expected.at(signature));
      without_memory += std::abs(forgotten.at(signature) - expected.at(signature));
      ++landmarks;
    }
  }
  ASSERT_GT(landmarks, 6);
  EXPECT_LT(with_memory / landmarks, 0.1);
  EXPECT_GT(without_memory / landmarks, 0.5);
}

// Whatever a run does not see between two sightings at one place stood there.
TEST(MissedVisits, AreNotBetweenTwoSightingsAtOnePlace) {
  const SimulatedWorld world = testing::Simulate(StillWorld(7));
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  const BuildState build = MapSingleRun(run, world.groups.size(), {});
  const auto missed = FindMissedVisits(build, FrontEndOptions().visit_gap_s, {});
  int before_or_after = 0;
  for (const GroupIndex group : missed.by_group.indices()) {
    for (const MissedVisit& visit : missed.by_group[group]) {
      bool seen_before = false;
      bool seen_after = false;
      for (const MappingVisit& seen : run.visits) {
        if (seen.group != group) continue;
        seen_before |= seen.end < visit.begin;
        seen_after |= seen.begin > visit.end;
        EXPECT_TRUE(seen.end < visit.begin || seen.begin > visit.end) << group.value();
      }
      EXPECT_FALSE(seen_before && seen_after) << group.value();
      ++before_or_after;
      EXPECT_EQ(visit.log_likelihoods[0], 0.0);
      EXPECT_LE(visit.log_likelihoods.maxCoeff(), 0.0);
    }
  }
  EXPECT_GT(before_or_after, 0);
}

}  // namespace
}  // namespace shiftmap
