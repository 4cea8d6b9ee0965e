// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_utias_selectors.h"

#include <optional>
#include <vector>

#include "tools/experiment/incremental/incremental_mapper.h"

namespace shiftmap {
namespace {

const Eigen::Vector3d kStartSd(0.05, 0.05, 0.02);

// Between motion-capture poses further apart than this the start is not known.
const Duration kMaxTruthGap = FromSeconds(2.0);

IncrementalPrior PriorOf(const UtiasCase& data, const LandmarkPlaces& map, double sd_m) {
  const Eigen::Index size = 2 * std::ssize(data.signatures);
  IncrementalPrior prior;
  prior.groups = static_cast<int>(data.signatures.size());
  prior.mean.resize(size);
  for (int group = 0; group < prior.groups; ++group) {
    prior.group.push_back(group);
    prior.mean.segment<2>(2 * Eigen::Index{group}) = map.at(data.signatures[GroupIndex(group)]);
  }
  prior.cov = Eigen::MatrixXd::Identity(size, size) * (sd_m * sd_m);
  return prior;
}

StatusOr<PoseWithCovariance> StartOf(const UtiasCase& data) {
  const std::optional<Se2> truth =
      Interpolate(data.truth, data.frames.frames.front().stamp, kMaxTruthGap);
  if (!truth) {
    return InvalidArgument(
        "utias data set {} robot {}: no motion capture at the start", data.dataset, data.robot);
  }
  return PoseWithCovariance{*truth, kStartSd.cwiseAbs2().asDiagonal()};
}

SensorCalibration SensorOf(const UtiasNoise& noise, const UtiasProtocol& protocol) {
  SensorCalibration sensor = noise.sensor;
  sensor.max_range_m = protocol.max_range_m;
  sensor.max_bearing_rad = protocol.max_bearing_rad;
  return sensor;
}

// The frames of a case as the incremental mapper takes them.
std::vector<IncrementalFrame> FramesOf(const UtiasCase& data, const UtiasNoise& noise) {
  const auto observations = UtiasObservations(data, noise);
  const auto motions = UtiasMotions(data, noise);
  std::vector<IncrementalFrame> frames;
  for (const FrameIndex f : data.frames.frames.indices()) {
    const KeyFrame& key_frame = data.frames.frames[f];
    IncrementalFrame& frame = frames.emplace_back();
    frame.stamp = key_frame.stamp;
    if (f > 0) frame.motion = motions[f - 1];
    for (const SightingIndex i : key_frame.sightings()) {
      const GroupIndex group = data.frames.visits[data.frames.sightings[i].visit].group;
      frame.observations.push_back({group.value(), observations[i]});
    }
  }
  return frames;
}

}  // namespace

IncrementalOptions PrintedSelectorOptions(SelectorKind kind,
                                          const UtiasNoise& noise,
                                          const UtiasProtocol& protocol) {
  IncrementalOptions options;
  options.selector.kind = kind;
  options.gate_probability = 0.95;
  options.min_sightings = 1;
  options.merge_probability = 0.0;
  options.sensor = SensorOf(noise, protocol);
  options.sensor.detection_probability = 0.6;
  options.smoother.loss_scale = noise.loss_scale;
  return options;
}

IncrementalOptions OwnSelectorOptions(const UtiasNoise& noise, const UtiasProtocol& protocol) {
  IncrementalOptions options;
  options.sensor = SensorOf(noise, protocol);
  options.smoother.loss_scale = noise.loss_scale;
  return options;
}

StatusOr<UtiasEstimate> SolveFrameByFrame(const UtiasCase& data,
                                          const UtiasNoise& noise,
                                          const LandmarkPlaces& map,
                                          double prior_sd_m,
                                          const IncrementalOptions& options) {
  SHIFTMAP_ASSIGN_OR_RETURN(const PoseWithCovariance start, StartOf(data));
  SHIFTMAP_ASSIGN_OR_RETURN(
      IncrementalMapper mapper,
      IncrementalMapper::Create(options, PriorOf(data, map, prior_sd_m), start));
  UtiasEstimate estimate;
  for (const IncrementalFrame& frame : FramesOf(data, noise)) {
    SHIFTMAP_ASSIGN_OR_RETURN(const IncrementalStep step, mapper.AddFrame(frame));
    estimate.created += step.modes_created - step.modes_merged;
    estimate.full_optimizations += step.fully_optimized ? 1 : 0;
    estimate.step_poses.push_back(mapper.T_map_vehicle());
  }
  SHIFTMAP_RETURN_IF_ERROR(mapper.Finish());
  estimate.poses = mapper.Trajectory();
  estimate.sighting_modes = mapper.Choices();
  for (std::size_t group = 0; group < data.signatures.size(); ++group) {
    estimate.modes.push_back(mapper.Modes(static_cast<int>(group)));
  }
  return estimate;
}

}  // namespace shiftmap
