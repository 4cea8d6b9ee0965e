// SPDX-License-Identifier: Apache-2.0
#include "tools/eval/trajectory_error.h"

#include <cmath>
#include <numeric>
#include <vector>

#include "mapstore/core/quantile.h"
#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

struct MatchedPose {
  Se2 estimate;
  Se2 truth;
};

}  // namespace

StatusOr<TrajectoryError> EvaluateTrajectory(std::span<const StampedPose> estimate,
                                             std::span<const StampedPose> truth,
                                             const TrajectoryErrorOptions& options) {
  TrajectoryError result;
  std::vector<MatchedPose> matches;
  for (const StampedPose& pose : estimate) {
    const std::optional<Se2> there = Interpolate(truth, pose.stamp, FromSeconds(options.max_gap_s));
    if (there) {
      matches.push_back({pose.T_map_vehicle, *there});
    } else {
      ++result.unmatched;
    }
  }
  if (matches.empty()) {
    return InvalidArgument(
        "no pose matches: {} estimated poses, {} true ones, none closer in time than {} s",
        estimate.size(),
        truth.size(),
        options.max_gap_s);
  }
  result.matched = static_cast<int>(matches.size());
  if (options.align) {
    std::vector<PointPair> pairs;
    for (const MatchedPose& match : matches) {
      pairs.push_back({match.truth.translation(), match.estimate.translation()});
    }
    SHIFTMAP_ASSIGN_OR_RETURN(result.T_truth_estimate, AlignRigid2d(pairs));
  }
  std::vector<double> distances;
  double sum_yaw2 = 0.0;
  for (const MatchedPose& match : matches) {
    const Se2 moved = result.T_truth_estimate * match.estimate;
    distances.push_back((moved.translation() - match.truth.translation()).norm());
    const double yaw = WrapAngle(moved.yaw() - match.truth.yaw());
    sum_yaw2 += yaw * yaw;
  }
  const auto n = static_cast<double>(distances.size());
  const double sum2 =
      std::inner_product(distances.begin(), distances.end(), distances.begin(), 0.0);
  result.position_rmse_m = std::sqrt(sum2 / n);
  result.position_mean_m = std::accumulate(distances.begin(), distances.end(), 0.0) / n;
  result.position_median_m = Quantile(distances, 0.5);
  result.position_p95_m = Quantile(distances, 0.95);
  result.position_max_m = Quantile(distances, 1.0);
  result.yaw_rmse_rad = std::sqrt(sum_yaw2 / n);
  return result;
}

}  // namespace shiftmap
