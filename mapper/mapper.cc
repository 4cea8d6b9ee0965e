// SPDX-License-Identifier: Apache-2.0
#include "mapper/mapper.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "mapper/datum.h"
#include "mapper/fleet_calibration.h"
#include "mapper/map_output.h"
#include "mapper/map_problem.h"
#include "mapper/mode_refinement.h"
#include "mapper/single_run.h"
#include "mapper/submap.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr int kNoiseRounds = 2;

// Puts the start of the earliest run at the origin of the map.
void AnchorFrame(MapProblem* problem) {
  const MappedRun first = MakeMappedRun(*problem, 0);
  MoveProblem(first.T_map_start.Inverse(), problem);
}

// What the runs by themselves say of the sensor, as the start of the common estimate.
SensorCalibration MeanSensor(const std::vector<Submap>& submaps,
                             const SensorCalibration& fallback) {
  if (submaps.empty()) return fallback;
  SensorCalibration mean = fallback;
  const auto average = [&](double SensorCalibration::*member) {
    double sum = 0.0;
    for (const Submap& submap : submaps) sum += std::pow(submap.problem.sensor.*member, 2);
    mean.*member = std::sqrt(sum / static_cast<double>(submaps.size()));
  };
  average(&SensorCalibration::sd_range_m);
  average(&SensorCalibration::sd_bearing_rad);
  average(&SensorCalibration::sd_position_m);
  return mean;
}

std::vector<MappingRun> PrepareRuns(const std::vector<MapperInput>& inputs,
                                    const std::vector<Signature>& signatures,
                                    const MapperOptions& options,
                                    std::vector<RejectedRun>* rejected) {
  std::vector<MappingRun> runs;
  for (const MapperInput& input : inputs) {
    MappingRun run = MakeMappingRun(input.run, signatures, options.front_end);
    run.name = input.name;
    run.sha256 = input.sha256;
    if (run.sightings.empty()) {
      rejected->push_back({input.name, "no identified landmark is seen"});
    } else {
      runs.push_back(std::move(run));
    }
  }
  return runs;
}

Status RequireRuns(bool any, const std::vector<RejectedRun>& rejected) {
  if (any) return OkStatus();
  if (rejected.empty()) return InvalidArgument("no runs to build from");
  return InvalidArgument(
      "no run can be used; first: run '{}': {}", rejected.front().name, rejected.front().reason);
}

}  // namespace

Status MapperOptions::Validate() const {
  const auto positive = [](double value) { return std::isfinite(value) && value > 0.0; };
  if (!positive(front_end.visit_gap_s))
    return InvalidArgument("visit_gap_s: {}, expected > 0", front_end.visit_gap_s);
  if (alignment.min_signatures < 2) {
    return InvalidArgument("min_signatures: {}, expected 2 or more", alignment.min_signatures);
  }
  if (modes.min_sightings < 1)
    return InvalidArgument("min_sightings: {}, expected 1 or more", modes.min_sightings);
  if (!positive(modes.position_floor_m) || !positive(modes.cluster_radius_m)) {
    return InvalidArgument("position_floor_m and cluster_radius_m: expected > 0");
  }
  if (!(modes.leave_rate_per_s >= 0.0)) {
    return InvalidArgument("leave_rate_per_s: {}, expected 0 or more", modes.leave_rate_per_s);
  }
  SHIFTMAP_RETURN_IF_ERROR(modes.selector.Validate());
  if (max_outer_iterations < 1 || max_solver_iterations < 1) {
    return InvalidArgument("iterations: expected 1 or more");
  }
  return OkStatus();
}

StatusOr<MapperResult> BuildMap(std::vector<MapperInput> inputs,
                                const std::optional<MapContent>& prior,
                                const MapperOptions& options,
                                const MapperProgress& progress) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  for (const MapperInput& input : inputs) {
    if (const Status valid = ValidateRun(input.run); !valid.ok()) {
      return MakeStatus(valid.code(), "run '{}': {}", input.name, Message(valid));
    }
  }
  const auto report = [&](const std::string& phase, double done) {
    if (progress) progress(phase, done);
  };
  // The order of time, whatever order the runs were named in.
  std::sort(inputs.begin(), inputs.end(), [](const MapperInput& a, const MapperInput& b) {
    return std::make_tuple(a.run.odometry.front().stamp, std::cref(a.sha256)) <
           std::make_tuple(b.run.odometry.front().stamp, std::cref(b.sha256));
  });

  MapperResult result;
  std::vector<Signature> known;
  if (prior) {
    for (const LandmarkGroup& group : prior->groups) known.push_back(group.signature);
  }
  std::vector<const Run*> all_runs;
  for (const MapperInput& input : inputs) all_runs.push_back(&input.run);
  const std::vector<Signature> signatures = CollectSignatures(all_runs, known);
  const std::vector<MappingRun> runs = PrepareRuns(inputs, signatures, options, &result.rejected);
  SHIFTMAP_RETURN_IF_ERROR(RequireRuns(!runs.empty(), result.rejected));

  std::vector<Submap> submaps;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    report(fmt::format("run {}", runs[i].name),
           static_cast<double>(i) / static_cast<double>(runs.size() + 1));
    submaps.push_back(MakeSubmap(options, MapSingleRun(runs[i], signatures, options)));
  }

  report("all runs", static_cast<double>(runs.size()) / static_cast<double>(runs.size() + 1));
  MapProblem problem =
      StartProblem(signatures, prior, MeanSensor(submaps, options.calibration.sensor));
  PlaceSubmaps(options, prior, std::move(submaps), &problem, &result.rejected);
  SHIFTMAP_RETURN_IF_ERROR(RequireRuns(!problem.runs.empty(), result.rejected));
  std::stable_sort(
      problem.runs.begin(), problem.runs.end(), [](const BuildRun& a, const BuildRun& b) {
        return std::tie(a.data->odometry.front().stamp, a.data->sha256) <
               std::tie(b.data->odometry.front().stamp, b.data->sha256);
      });
  if (!prior) AnchorFrame(&problem);

  result.outer_iterations = RefineModes(options, &problem);
  if (options.calibrate) {
    problem.sensor = EstimateDetection(problem, options.modes);
    CalibrateNoise(options, kNoiseRounds, &problem);
    result.outer_iterations += RefineModes(options, &problem);
  }
  if (!prior) AnchorFrame(&problem);
  const Graph graph = MakeGraph(options, &problem);
  Eigen::MatrixXd mode_covariance = ComputeModeCovariance(graph);
  if (!prior) mode_covariance = ReferToPositions(graph.modes, mode_covariance);
  mode_covariance = AddScaleUncertainty(graph.modes, options.sd_range_scale, mode_covariance);

  SHIFTMAP_ASSIGN_OR_RETURN(MapOutput output,
                            MakeMapContent(problem, prior, mode_covariance, options));
  result.content = std::move(output.content);
  result.chains = std::move(output.chains);
  SHIFTMAP_RETURN_IF_ERROR(ValidateMapContent(result.content));
  for (std::size_t i = 0; i < problem.runs.size(); ++i)
    result.runs.push_back(MakeMappedRun(problem, i));
  for (const std::vector<BuildMode>& group : problem.modes) {
    for (const BuildMode& mode : group) result.modes_created += mode.number == kAbsent;
  }
  result.modes_merged = problem.modes_merged;
  result.selection = SummarizeSelection(options.modes, problem);
  report("done", 1.0);
  return result;
}

}  // namespace shiftmap
