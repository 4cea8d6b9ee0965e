// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_utias_score.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "localizer/hypothesis/log_math.h"
#include "localizer/models/observation_model.h"
#include "mapper/graph/sensor_bias.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// Between motion-capture poses further apart than this the truth is not known.
const Duration kMaxTruthGap = FromSeconds(1.0);

// Of a pose, when a visit is scored against a mode. [m]
constexpr double kPoseSd = 0.1;

// Share of the visits of each landmark that each of its modes explains.
IndexedVector<GroupIndex, std::vector<double>> ExplainedVisits(const UtiasCase& data,
                                                               const UtiasEstimate& estimate) {
  IndexedVector<GroupIndex, std::vector<double>> weights;
  for (const auto& modes : estimate.modes) weights.emplace_back(modes.size(), 0.0);
  for (const MappingVisit& visit : data.frames.visits) {
    const double share = 1.0 / static_cast<double>(visit.sightings.size());
    for (const SightingIndex sighting : visit.sightings) {
      const int mode = estimate.sighting_modes[sighting];
      if (mode < 0) continue;
      weights[visit.group][static_cast<std::size_t>(mode)] += share;
    }
  }
  return weights;
}

double SquaredLandmarkError(const std::vector<Eigen::Vector2d>& modes,
                            const std::vector<double>& weights,
                            const Eigen::Vector2d& truth) {
  double sum = 0.0;
  double total = 0.0;
  for (std::size_t k = 0; k < modes.size(); ++k) {
    sum += weights[k] * (modes[k] - truth).squaredNorm();
    total += weights[k];
  }
  return total > 0.0 ? sum / total : (modes.front() - truth).squaredNorm();
}

// Log-likelihood of a visit: clutter first, then every mode.
Eigen::VectorXd ScoreVisit(const UtiasCase& data,
                           const MappingVisit& visit,
                           const MappedRun& run,
                           const SensorCalibration& sensor,
                           const std::vector<Eigen::Vector2d>& modes) {
  Eigen::VectorXd scores = Eigen::VectorXd::Zero(std::ssize(modes) + 1);
  for (const SightingIndex index : visit.sightings) {
    const Sighting& sighting = data.frames.sightings[index];
    const double log_clutter =
        std::log((sensor.clutter_density_per_m2) * SquareMetresPerUnit(sighting.observation));
    scores[0] += log_clutter;
    for (std::size_t k = 0; k < modes.size(); ++k) {
      const Innovation innovation = LinearizeBiased(
          sighting.observation,
          run.trajectory[static_cast<std::size_t>(sighting.frame.value())].T_map_vehicle,
          modes[k],
          run.sensor_bias,
          data.frames.mean_squared_bearing);
      const Eigen::Matrix2d S =
          ObservationNoise(sighting.observation, sensor) +
          kPoseSd * kPoseSd * innovation.H_landmark * innovation.H_landmark.transpose();
      scores[static_cast<Eigen::Index>(k) + 1] += LogAdd(
          std::log(sensor.detection_probability) + LogGaussian(innovation.nu, S), log_clutter);
    }
  }
  return scores;
}

// RMSE of the position over the key frames with a true pose; 0 for no poses.
double PoseRmse(const UtiasCase& data, const std::vector<Se2>& poses, int* count) {
  double squares = 0.0;
  *count = 0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const std::optional<Se2> truth =
        Interpolate(data.truth, data.frames.frames[FrameIndex(i)].stamp, kMaxTruthGap);
    if (!truth) continue;
    squares += (poses[i].translation() - truth->translation()).squaredNorm();
    ++*count;
  }
  return poses.empty() ? 0.0 : std::sqrt(squares / *count);
}

}  // namespace

UtiasScore ScoreUtias(const UtiasCase& data, const UtiasEstimate& estimate) {
  SHIFTMAP_CHECK(estimate.poses.size() == data.frames.frames.size() &&
                     estimate.modes.size() == data.signatures.size() &&
                     estimate.sighting_modes.size() == data.frames.sightings.size(),
                 "{} poses of {} key frames",
                 estimate.poses.size(),
                 data.frames.frames.size());
  UtiasScore score;
  int step_poses = 0;
  score.pose_rmse_m = PoseRmse(data, estimate.poses, &score.poses);
  score.step_pose_rmse_m = PoseRmse(data, estimate.step_poses, &step_poses);

  IndexedVector<GroupIndex, bool> seen(data.signatures.size());
  for (const MappingVisit& visit : data.frames.visits) seen[visit.group] = true;
  const auto weights = ExplainedVisits(data, estimate);
  double squares = 0.0;
  for (const GroupIndex group : data.signatures.indices()) {
    const std::vector<Eigen::Vector2d>& modes = estimate.modes[group];
    score.modes += static_cast<int>(modes.size());
    if (!seen[group] || modes.empty()) continue;
    squares +=
        SquaredLandmarkError(modes, weights[group], data.landmarks.at(data.signatures[group]));
    ++score.landmarks;
  }
  score.landmark_rmse_m = std::sqrt(squares / score.landmarks);
  return score;
}

std::optional<double> ProbabilityOfTruth(const UtiasCase& data, const UtiasEstimate& estimate) {
  if (estimate.ambiguous_changes.empty()) return std::nullopt;
  for (const AmbiguousChange& change : estimate.ambiguous_changes) {
    for (const AmbiguousChange::Alternative& alternative : change.explanations) {
      const auto is_true = [&](const std::vector<Signature>& signatures, bool moved) {
        return std::all_of(signatures.begin(), signatures.end(), [&](const Signature& signature) {
          return std::binary_search(data.moved.begin(), data.moved.end(), signature) == moved;
        });
      };
      if (is_true(alternative.stayed, false) && is_true(alternative.moved, true)) {
        return alternative.probability;
      }
    }
  }
  return 0.0;
}

UtiasEstimate FromMapperResult(const UtiasCase& data, const MapperResult& result) {
  UtiasEstimate estimate;
  estimate.ambiguous_changes = result.ambiguous_changes;
  if (result.runs.empty()) return estimate;
  const MappedRun& run = result.runs.front();
  for (const StampedPose& pose : run.trajectory) estimate.poses.push_back(pose.T_map_vehicle);
  for (const Signature& signature : data.signatures) {
    std::vector<Eigen::Vector2d>& modes = estimate.modes.emplace_back();
    for (const LandmarkGroup& group : result.content.groups) {
      if (group.signature != signature) continue;
      for (const Mode& mode : group.modes) modes.push_back(mode.p_map_landmark);
    }
  }
  estimate.sighting_modes.assign(data.frames.sightings.size(), -1);
  for (const MappingVisit& visit : data.frames.visits) {
    Eigen::Index best = 0;
    ScoreVisit(data, visit, run, result.content.calibration.sensor, estimate.modes[visit.group])
        .maxCoeff(&best);
    for (const SightingIndex sighting : visit.sightings) {
      estimate.sighting_modes[sighting] = static_cast<int>(best) - 1;
    }
  }
  estimate.created = result.modes_created;
  return estimate;
}

}  // namespace shiftmap
