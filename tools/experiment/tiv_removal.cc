// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/tiv_removal.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <utility>

#include "localizer/models/observation_model.h"
#include "tools/experiment/static_slam.h"

namespace shiftmap {
namespace {

// Scans before the first sighting of a corner, and after the last.
constexpr std::size_t kBefore = 10;
constexpr std::size_t kAfter = 5;

// A point this near to a landmark is of it. [m]
constexpr double kOfLandmark = 1.0;

bool SeesCorner(const TivDrive::Step& step) {
  const auto& seen = step.scan.observations;
  return std::any_of(seen.begin(), seen.end(), [](const Observation& observation) {
    return !observation.signature.anonymous();
  });
}

// The part of a drive that passes the corners.
std::pair<std::size_t, std::size_t> PartPastCorners(const TivDrive& drive) {
  const auto first = std::find_if(drive.steps.begin(), drive.steps.end(), SeesCorner);
  const auto last = std::find_if(drive.steps.rbegin(), drive.steps.rend(), SeesCorner);
  const auto begin = static_cast<std::size_t>(first - drive.steps.begin());
  const auto end = drive.steps.size() - static_cast<std::size_t>(last - drive.steps.rbegin());
  return {begin - std::min(begin, kBefore), std::min(end + kAfter, drive.steps.size())};
}

// Positions of the landmarks without signature that are taken out.
std::vector<Eigen::Vector2d> ChooseRemoved(const SlamMap& map,
                                           double share,
                                           std::mt19937_64* random) {
  std::vector<Eigen::Vector2d> positions;
  for (const AnonymousLandmark& landmark : map.anonymous()) {
    positions.push_back(map.state().Position(landmark.landmark));
  }
  std::shuffle(positions.begin(), positions.end(), *random);
  positions.resize(
      static_cast<std::size_t>(std::lround(share * static_cast<double>(positions.size()))));
  return positions;
}

bool IsOneOf(const Eigen::Vector2d& p,
             const std::vector<Eigen::Vector2d>& positions,
             double reach) {
  return std::any_of(positions.begin(), positions.end(), [&](const Eigen::Vector2d& other) {
    return (p - other).norm() <= reach;
  });
}

// Takes the points of landmarks that are gone out of a scan, and as large a share of those of no
// landmark of the map.
void RemovePoints(const std::vector<Eigen::Vector2d>& kept,
                  const std::vector<Eigen::Vector2d>& removed,
                  double share,
                  const Se2& truth,
                  std::mt19937_64* random,
                  Scan* scan) {
  std::bernoulli_distribution gone(share);
  std::erase_if(scan->observations, [&](const Observation& observation) {
    const bool drawn = gone(*random);
    if (!observation.signature.anonymous()) return false;
    const Eigen::Vector2d p = LandmarkPosition(observation, truth);
    if (IsOneOf(p, kept, kOfLandmark)) return false;
    return IsOneOf(p, removed, kOfLandmark) || drawn;
  });
}

// A landmark of either mode that is not the last one found: where the corner was in the original.
void ForgetOriginal(const TreeSlam& both, StaticSlam* slam) {
  for (const LandmarkGroup& group : both.groups()) {
    if (group.modes.size() > 1) slam->Forget(group.signature, 0);
  }
}

double Distance(const Se2& pose, const Se2& truth) {
  return (pose.translation() - truth.translation()).norm();
}

}  // namespace

StatusOr<TivWorld> MapBothVersions(const TivWorld& world, std::uint64_t seed) {
  SHIFTMAP_ASSIGN_OR_RETURN(const TivDrive drive, world.Simulate(PlanVersion::kModified, seed, 1));
  TreeSlam slam = world.mapped();
  Filter(world, drive, world.Start(drive.steps.front().truth, seed), &slam);
  return world.WithMap(std::move(slam));
}

StatusOr<TivRemovalRun> RunTivRemoval(const TivWorld& both, double share, std::uint64_t seed) {
  SHIFTMAP_ASSIGN_OR_RETURN(const TivDrive drive, both.Simulate(PlanVersion::kOriginal, seed, 2));
  const auto [begin, end] = PartPastCorners(drive);
  if (begin >= end) return InvalidArgument("seed {}: the drive sees no corner", seed);
  std::mt19937_64 random(seed);
  TreeSlam multi = both.mapped();
  const std::vector<Eigen::Vector2d> removed = ChooseRemoved(multi.best().filter, share, &random);
  const auto is_removed = [&](const Eigen::Vector2d& p) { return IsOneOf(p, removed, 0.0); };
  multi.ForgetAnonymous(is_removed);
  std::vector<Eigen::Vector2d> kept;
  for (const AnonymousLandmark& landmark : multi.best().filter.anonymous()) {
    kept.push_back(multi.best().filter.state().Position(landmark.landmark));
  }
  const Calibration& calibration = both.calibration();
  StaticSlam decay(StaticPolicy::kAddUngated, both.tree(), multi);
  ForgetOriginal(multi, &decay);
  StaticSlam rejection(StaticPolicy::kIgnore, both.tree(), multi);
  SlamState reckoning(calibration);
  const TivDrive::Step& first = drive.steps[begin];
  const PoseWithCovariance start = both.Start(first.truth, seed);
  multi.BeginRun(start, calibration, first.scan.stamp);
  decay.BeginRun(start, calibration);
  rejection.BeginRun(start, calibration);
  reckoning.StartFrom(start, calibration);
  for (std::size_t i = begin; i < end; ++i) {
    TivDrive::Step step = drive.steps[i];
    if (i == begin) step.odometry.clear();
    RemovePoints(kept, removed, share, step.truth, &random, &step.scan);
    Filter(both, drive, step, &multi);
    for (StaticSlam* fixed : {&decay, &rejection}) {
      Predict(both, drive, step, &fixed->state());
      fixed->Correct(step.scan);
    }
    Predict(both, drive, step, &reckoning);
  }
  const Se2& truth = drive.steps[end - 1].truth;
  TivRemovalRun run;
  run.best_active = std::numeric_limits<double>::infinity();
  for (const SlamLeaf* leaf : multi.leaves().all()) {
    run.best_active = std::min(run.best_active, Distance(leaf->filter.state().pose(), truth));
  }
  run.most_likely = Distance(multi.best().filter.state().pose(), truth);
  run.memory_decay = Distance(decay.state().pose(), truth);
  run.rejection = Distance(rejection.state().pose(), truth);
  run.reckoning = Distance(reckoning.pose(), truth);
  return run;
}

}  // namespace shiftmap
