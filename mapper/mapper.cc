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
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr int kNoiseRounds = 2;

// A run mapped by itself, waiting for its place in the common frame.
struct Submap {
  MapProblem problem;
  std::vector<AlignmentPoint> points;
};

void MovePoses(const Se2& T_map_old, MapProblem* problem) {
  for (BuildRun& run : problem->runs) {
    for (Se2& pose : run.poses) pose = T_map_old * pose;
  }
  for (std::vector<BuildMode>& group : problem->modes) {
    for (BuildMode& mode : group) mode.p_map_landmark = T_map_old * mode.p_map_landmark;
  }
}

// The problem before any run is in it: the prior's modes, or none.
MapProblem StartProblem(const std::vector<Signature>& signatures,
                        const std::optional<MapContent>& prior,
                        const SensorCalibration& sensor) {
  MapProblem problem;
  problem.signatures = signatures;
  problem.sensor = sensor;
  problem.modes.resize(signatures.size());
  if (!prior) return problem;
  std::vector<int> flat;
  std::vector<Eigen::Vector2d> positions;
  for (const LandmarkGroup& group : prior->groups) {
    const auto g = static_cast<std::size_t>(
        std::lower_bound(signatures.begin(), signatures.end(), group.signature) -
        signatures.begin());
    for (const Mode& mode : group.modes) {
      problem.modes[g].push_back({mode.p_map_landmark, mode.number});
      flat.push_back(static_cast<int>(flat.size()));
      positions.push_back(mode.p_map_landmark);
    }
  }
  problem.prior = MakeGraphPrior(flat, positions, prior->covariance.Dense());
  return problem;
}

// Reference for alignment: every mode that the problem has so far.
std::vector<AlignmentPoint> ReferencePoints(const MapProblem& problem) {
  std::vector<AlignmentPoint> points;
  for (std::size_t group = 0; group < problem.modes.size(); ++group) {
    for (const BuildMode& mode : problem.modes[group]) {
      points.push_back({static_cast<int>(group), mode.p_map_landmark, Eigen::Matrix2d::Zero()});
    }
  }
  return points;
}

// Adds a submap, already moved into the map frame: its modes that the alignment cannot tell from
// one of the map become that one, the others are new modes of their groups.
// @param alignment  Nothing for the first submap, which meets no other.
void Absorb(const ModeOptions& options,
            const std::optional<Alignment>& alignment,
            MapProblem submap,
            MapProblem* problem) {
  const double gate = ChiSquareQuantile(options.merge_probability, 2);
  BuildRun& run = submap.runs.front();
  std::vector<std::vector<int>> becomes(submap.modes.size());
  for (std::size_t group = 0; group < submap.modes.size(); ++group) {
    const std::vector<BuildMode>& known = problem->modes[group];
    const std::size_t known_count = known.size();
    for (const BuildMode& mode : submap.modes[group]) {
      int nearest = kNoMode;
      double nearest_squared = gate;
      for (std::size_t k = 0; k < known_count && alignment; ++k) {
        const double variance = alignment->PositionVariance(mode.p_map_landmark) +
                                2.0 * options.position_floor_m * options.position_floor_m;
        const double squared =
            (known[k].p_map_landmark - mode.p_map_landmark).squaredNorm() / variance;
        if (squared < nearest_squared) {
          nearest_squared = squared;
          nearest = static_cast<int>(k);
        }
      }
      if (nearest == kNoMode) {
        nearest = AddMode(static_cast<int>(group), {mode.p_map_landmark, kAbsent}, problem);
      }
      becomes[group].push_back(nearest);
    }
  }
  for (std::size_t v = 0; v < run.assignment.size(); ++v) {
    int& assignment = run.assignment[v];
    const auto group = static_cast<std::size_t>(run.data->visits[v].group);
    if (assignment != kNoMode) assignment = becomes[group][static_cast<std::size_t>(assignment)];
  }
  problem->runs.push_back(std::move(run));
}

// Places submaps one after the other, always the one that most signatures tie to what is there.
void PlaceSubmaps(const MapperOptions& options,
                  std::vector<Submap> waiting,
                  MapProblem* problem,
                  std::vector<RejectedRun>* rejected) {
  if (ReferencePoints(*problem).empty()) {
    // Without a prior the run that sees most landmarks is the first.
    const auto first =
        std::max_element(waiting.begin(), waiting.end(), [](const Submap& a, const Submap& b) {
          return a.points.size() < b.points.size();
        });
    Absorb(options.modes, std::nullopt, std::move(first->problem), problem);
    waiting.erase(first);
  }
  while (!waiting.empty()) {
    const std::vector<AlignmentPoint> reference = ReferencePoints(*problem);
    std::size_t best = waiting.size();
    std::optional<Alignment> alignment;
    for (std::size_t i = 0; i < waiting.size(); ++i) {
      std::optional<Alignment> found =
          AlignByConsensus(reference, waiting[i].points, options.alignment);
      if (!found) continue;
      if (!alignment || found->signatures.size() > alignment->signatures.size()) {
        alignment = std::move(found);
        best = i;
      }
    }
    if (!alignment) break;
    MovePoses(alignment->T_reference_other, &waiting[best].problem);
    Absorb(options.modes, alignment, std::move(waiting[best].problem), problem);
    waiting.erase(waiting.begin() + static_cast<std::ptrdiff_t>(best));
  }
  for (const Submap& submap : waiting) {
    rejected->push_back(
        {submap.problem.runs.front().data->name,
         fmt::format("no consistent alignment with the other runs ({} landmarks seen)",
                     submap.points.size())});
  }
}

// Puts the start of the earliest run at the origin of the map.
void AnchorFrame(MapProblem* problem) {
  const MappedRun first = MakeMappedRun(*problem, 0);
  MovePoses(first.T_map_start.Inverse(), problem);
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
    Submap submap{MapSingleRun(runs[i], signatures, options), {}};
    submap.points = AlignmentPoints(options, &submap.problem);
    submaps.push_back(std::move(submap));
  }

  report("all runs", static_cast<double>(runs.size()) / static_cast<double>(runs.size() + 1));
  MapProblem problem =
      StartProblem(signatures, prior, MeanSensor(submaps, options.calibration.sensor));
  PlaceSubmaps(options, std::move(submaps), &problem, &result.rejected);
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
  const Graph graph = SolveContinuous(options, &problem);
  Eigen::MatrixXd mode_covariance = ComputeGraphPosterior(graph, 0, options.seed).mode_covariance;
  if (!prior) mode_covariance = ReferToPositions(graph.modes, mode_covariance);
  mode_covariance = AddScaleUncertainty(graph.modes, options.sd_range_scale, mode_covariance);

  result.content = MakeMapContent(problem, prior, mode_covariance, options);
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
