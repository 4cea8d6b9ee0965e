// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/localizer_recorded.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <variant>

#include "localizer/localizer.h"
#include "mapstore/geometry/covariance.h"
#include "tools/eval/trajectory_error.h"

namespace shiftmap {
namespace {

const Duration kMaxTruthGap = FromSeconds(1.0);

// A landmark that stands farther from each of its modes is at none of them. [m]
constexpr double kAtMode = 0.6;

// A wrong decision is withdrawn within as long, or stays. [s]
constexpr double kWithdrawn = 20.0;

ModeNumber TrueMode(const LandmarkGroup& group,
                    const Se2& T_truth_map,
                    const Eigen::Vector2d& p_truth) {
  ModeNumber nearest = kAbsent;
  double least = kAtMode;
  for (const Mode& mode : group.modes) {
    const double distance = (T_truth_map * mode.p_map_landmark - p_truth).norm();
    if (distance >= least) continue;
    least = distance;
    nearest = mode.number;
  }
  return nearest;
}

double MeanNees(const std::vector<PoseEstimate>& estimates,
                const std::vector<StampedPose>& truth,
                const Se2& T_truth_map) {
  double sum = 0.0;
  int count = 0;
  for (const PoseEstimate& estimate : estimates) {
    const std::optional<Se2> pose = Interpolate(truth, estimate.stamp, kMaxTruthGap);
    if (!pose) continue;
    sum += SquaredMahalanobis(
        T_truth_map * estimate.pose.T_map_vehicle, *pose, estimate.pose.cov_T_map_vehicle);
    ++count;
  }
  return sum / std::max(count, 1);
}

void CountDecisions(const std::vector<Decision>& decisions,
                    const MapSnapshot& map,
                    const std::map<Signature, Eigen::Vector2d>& places,
                    const Se2& T_truth_map,
                    RecordedResult* result) {
  for (std::size_t i = 0; i < decisions.size(); ++i) {
    const Decision& decision = decisions[i];
    const auto place = places.find(decision.signature);
    if (place == places.end()) continue;
    const int group = map.GroupIndex(decision.signature);
    const ModeNumber right =
        TrueMode(map.groups()[static_cast<std::size_t>(group)], T_truth_map, place->second);
    ++result->decisions;
    if (decision.mode == right) continue;
    ++result->wrong;
    const bool withdrawn =
        std::any_of(decisions.begin() + static_cast<std::ptrdiff_t>(i) + 1,
                    decisions.end(),
                    [&](const Decision& later) {
                      return later.signature == decision.signature && later.mode == right &&
                             ToSeconds(later.stamp - decision.stamp) < kWithdrawn;
                    });
    result->wrong_last += !withdrawn;
  }
}

}  // namespace

Run WithBlindStretches(const Run& run, const BlindStretches& stretches) {
  Run seen = run;
  if (stretches.blind_s <= 0.0 || run.scans.empty()) return seen;
  seen.scans.clear();
  std::optional<Signature> alone;
  for (const Scan& scan : run.scans) {
    const double elapsed = ToSeconds(scan.stamp - run.scans.front().stamp);
    const double phase = std::fmod(elapsed, stretches.every_s);
    // The first one comes when the vehicle knows where it is.
    if (elapsed < stretches.every_s || phase >= stretches.blind_s + stretches.alone_s) {
      alone.reset();
      seen.scans.push_back(scan);
      continue;
    }
    if (phase < stretches.blind_s) continue;
    Scan single;
    single.stamp = scan.stamp;
    for (const Observation& observation : scan.observations) {
      if (!alone) alone = observation.signature;
      if (observation.signature == *alone) single.observations.push_back(observation);
    }
    seen.scans.push_back(single);
  }
  return seen;
}

StatusOr<RecordedResult> LocalizeRecorded(const MapSnapshot& map,
                                          const Run& run,
                                          const std::vector<StampedPose>& truth,
                                          const std::map<Signature, Eigen::Vector2d>& places) {
  Localizer localizer(map, LocalizerOptions());
  std::vector<PoseEstimate> estimates;
  std::optional<Stamp> begin;
  RecordedResult result;
  const auto take = [&](const RunEvent& event) -> Status {
    if (!begin) begin = StampOf(event);
    const bool waits = !localizer.Estimate();
    SHIFTMAP_RETURN_IF_ERROR(localizer.Process(event));
    if (waits && localizer.Estimate()) result.start_s = ToSeconds(StampOf(event) - *begin);
    const auto& fresh = localizer.new_estimates();
    estimates.insert(estimates.end(), fresh.begin(), fresh.end());
    return OkStatus();
  };
  SHIFTMAP_RETURN_IF_ERROR(ForEachEvent(run, take));
  localizer.Finish();
  if (estimates.empty()) return InvalidArgument("the run is never localized");
  std::vector<StampedPose> trajectory;
  for (const PoseEstimate& estimate : estimates) {
    trajectory.push_back({estimate.stamp, estimate.pose.T_map_vehicle});
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const TrajectoryError error,
                            EvaluateTrajectory(trajectory, truth, {.align = true}));
  const LocalizerStatistics statistics = localizer.Statistics();
  result.rmse_m = error.position_rmse_m;
  result.nees = MeanNees(estimates, truth, error.T_truth_estimate);
  const double updates = static_cast<double>(std::max<std::int64_t>(statistics.updates, 1));
  result.nis = statistics.nis_sum / updates;
  result.lost_s = statistics.seconds_in_state[static_cast<std::size_t>(LocalizerState::kLost)];
  CountDecisions(localizer.Report().decisions, map, places, error.T_truth_estimate, &result);
  return result;
}

}  // namespace shiftmap
