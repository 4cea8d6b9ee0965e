// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/tiv_mine.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "mapstore/geometry/covariance.h"
#include "tools/experiment/static_slam.h"

namespace shiftmap {
namespace {

TivError ErrorOf(const PoseWithCovariance& pose, const Se2& truth) {
  return {(pose.T_map_vehicle.translation() - truth.translation()).norm(),
          SquaredMahalanobis(pose.T_map_vehicle, truth, pose.cov_T_map_vehicle)};
}

const LandmarkGroup* Find(const MapContent& content, const Signature& signature) {
  const auto found = std::find_if(content.groups.begin(),
                                  content.groups.end(),
                                  [&](const auto& group) { return group.signature == signature; });
  return found == content.groups.end() ? nullptr : &*found;
}

std::vector<TivCorner> JudgeCorners(const TivWorld& world,
                                    const std::map<Signature, int>& sightings,
                                    const MapContent& posterior) {
  std::vector<TivCorner> corners;
  for (const LandmarkGroup& before : world.mapped().groups()) {
    if (before.modes.empty()) continue;
    const auto seen = sightings.find(before.signature);
    if (seen == sightings.end() || seen->second < world.tree().min_sightings) continue;
    const LandmarkGroup& after = *Find(posterior, before.signature);
    TivCorner corner{before.signature.text(), seen->second, 0.0, 0.0};
    corner.p_prior = after.probabilities(1);
    Eigen::Index likeliest = 0;
    after.probabilities.maxCoeff(&likeliest);
    corner.distance_m = likeliest == 0
                            ? std::numeric_limits<double>::quiet_NaN()
                            : (after.modes[static_cast<std::size_t>(likeliest) - 1].p_map_landmark -
                               *world.Corner(before.signature, PlanVersion::kModified))
                                  .norm();
    corners.push_back(std::move(corner));
  }
  return corners;
}

}  // namespace

StatusOr<TivMineRun> RunTivMine(const TivWorld& world, std::uint64_t seed) {
  SHIFTMAP_ASSIGN_OR_RETURN(const TivDrive drive, world.Simulate(PlanVersion::kModified, seed, 1));
  const Calibration& calibration = world.calibration();
  const PoseWithCovariance start = world.Start(drive.steps.front().truth, seed);
  TreeSlam multi = world.mapped();
  multi.BeginRun(start, calibration, drive.steps.front().scan.stamp);
  StaticSlam fixed(StaticPolicy::kAlwaysUpdate, world.tree(), world.mapped());
  fixed.BeginRun(start, calibration);
  SlamState reckoning(calibration);
  reckoning.StartFrom(start, calibration);
  TivMineRun run;
  std::map<Signature, int> sightings;
  for (const TivDrive::Step& step : drive.steps) {
    Filter(world, drive, step, &multi);
    Predict(world, drive, step, &fixed.state());
    fixed.Correct(step.scan);
    Predict(world, drive, step, &reckoning);
    bool seen = false;
    for (const Observation& observation : step.scan.observations) {
      if (observation.signature.anonymous()) continue;
      ++sightings[observation.signature];
      seen = true;
    }
    run.corner_seen.push_back(seen);
    run.leaves.push_back(static_cast<int>(multi.leaves().size()));
    run.multi.push_back(ErrorOf(multi.best().filter.Pose(), step.truth));
    run.fixed.push_back(ErrorOf(fixed.Pose(), step.truth));
    run.reckoning.push_back(ErrorOf(reckoning.Pose(), step.truth));
    run.truth.push_back(step.truth);
    run.multi_poses.push_back(multi.best().filter.Pose().T_map_vehicle);
    run.fixed_poses.push_back(fixed.Pose().T_map_vehicle);
  }
  multi.EndRun();
  run.posterior = multi.Content();
  run.corners = JudgeCorners(world, sightings, run.posterior);
  return run;
}

std::vector<TivMineStep> MeanOverRuns(const std::vector<TivMineRun>& runs,
                                      const std::vector<TivError> TivMineRun::*method) {
  std::vector<TivMineStep> steps((runs.front().*method).size());
  const auto n = static_cast<double>(runs.size());
  for (const TivMineRun& run : runs) {
    for (std::size_t i = 0; i < steps.size(); ++i) {
      steps[i].rmse_m += std::pow((run.*method)[i].distance_m, 2) / n;
      steps[i].nees += (run.*method)[i].nees / n;
    }
  }
  for (TivMineStep& step : steps) step.rmse_m = std::sqrt(step.rmse_m);
  return steps;
}

}  // namespace shiftmap
