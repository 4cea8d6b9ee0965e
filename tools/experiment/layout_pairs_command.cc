// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/layout_pairs_command.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapper/alignment/explain_alignment.h"
#include "mapper/calibration/noise_calibration.h"
#include "mapper/frontend/mapping_run.h"
#include "mapper/rows.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/run_maps/single_run.h"
#include "mapper/run_maps/variance_factor.h"
#include "mapstore/run/trajectory.h"
#include "tools/convert/utias.h"
#include "tools/experiment/enumerate_hypotheses.h"
#include "tools/experiment/experiment_output.h"

namespace shiftmap {
namespace {

constexpr int kRobots = 5;

struct Arguments {
  std::string data;
  std::string output;
};

// A recorded run, mapped by itself.
struct LayoutRun {
  std::string name;
  JointPoints map;  // One mode of each landmark.
  Se2 T_survey_map;
};

// Two maps of different layouts, explained one way.
struct PairResult {
  double probability = 0.0;  // Of the likeliest frame,
  bool is_right = false;     // which is right.
  double of_right = 0.0;     // Of all frames that are right.
};

// One mode of each landmark, that of least variance: all that is enumerated.
JointPoints OneModeEach(const JointPoints& map) {
  std::map<GroupIndex, ModeIndex> best;
  for (const ModeIndex i : map.points.indices()) {
    const auto [known, is_first] = best.emplace(map.points[i].group, i);
    if (!is_first && map.points[i].cov.trace() < map.points[known->second].cov.trace()) {
      known->second = i;
    }
  }
  JointPoints one;
  std::vector<Eigen::Index> rows;
  for (const auto& [group, i] : best) {
    one.points.push_back(map.points[i]);
    rows.insert(rows.end(), {RowOf(i), RowOf(i) + 1});
  }
  one.covariance = map.covariance(rows, rows);
  return one;
}

StatusOr<std::vector<LayoutRun>> MapLayout(const std::string& dataset_dir, int dataset) {
  const MapperOptions options;
  SHIFTMAP_ASSIGN_OR_RETURN(const auto places, ReadUtiasLandmarks(dataset_dir));
  IndexedVector<GroupIndex, Signature> signatures;
  for (const auto& [signature, place] : places) signatures.push_back(signature);
  std::vector<LayoutRun> runs;
  for (int robot = 1; robot <= kRobots; ++robot) {
    if (!std::filesystem::exists(fmt::format("{}/Robot{}_Measurement.dat", dataset_dir, robot))) {
      continue;
    }
    UtiasOptions utias;
    utias.dataset_dir = dataset_dir;
    utias.robot = robot;
    SHIFTMAP_ASSIGN_OR_RETURN(const UtiasRun recorded, ReadUtias(utias));
    const MappingRun run = MakeMappingRun(recorded.run, signatures, options.front_end);
    std::vector<BuildState> builds = {MapSingleRun(run, signatures.size(), options)};
    RaiseNoiseByVehicle(&builds);
    const std::optional<RunMap> run_map = MakeUndistortedRunMap(options, std::move(builds.front()));
    if (!run_map) continue;
    std::vector<PointPair> pairs;
    for (const AlignmentPoint& point : run_map->points) {
      pairs.push_back({places.at(signatures[point.group]), point.position});
    }
    SHIFTMAP_ASSIGN_OR_RETURN(const Se2 T_survey_map, AlignRigid2d(pairs));
    const double factor = VarianceFactor(options, run_map->build);
    runs.push_back({fmt::format("set {} robot {}", dataset, robot),
                    OneModeEach({run_map->points, factor * run_map->covariance}),
                    T_survey_map});
  }
  return runs;
}

PairResult Judge(const LayoutRun& reference,
                 const LayoutRun& other,
                 double same_frame_m,
                 const Explanations& explanations) {
  const Se2 T_reference_other = reference.T_survey_map.Inverse() * other.T_survey_map;
  const auto is_right = [&](const Explanation& frame) {
    return !frame.nothing_stayed() &&
           std::all_of(
               other.map.points.begin(), other.map.points.end(), [&](const AlignmentPoint& point) {
                 return (frame.alignment.T_reference_other * point.position -
                         T_reference_other * point.position)
                            .norm() < same_frame_m;
               });
  };
  PairResult result{explanations.frames.front().probability, is_right(explanations.frames.front())};
  for (const Explanation& frame : explanations.frames) {
    if (is_right(frame)) result.of_right += frame.probability;
  }
  return result;
}

void AddPair(const LayoutRun& reference, const LayoutRun& other, ResultTable* table) {
  const ConfirmationOptions options;
  const AlignmentEvidence evidence(
      reference.map, other.map, OccupiedArea(PositionsOf(reference.map.points)), options.prior);
  const double tolerance_m = options.limits.same_frame_m;
  const PairResult searched =
      Judge(reference,
            other,
            tolerance_m,
            SumToExplanations(evidence, SearchHypotheses(evidence), options.limits));
  const PairResult all =
      Judge(reference,
            other,
            tolerance_m,
            SumToExplanations(evidence, EnumerateHypotheses(evidence), options.limits));
  table->AddRow({reference.name,
                 other.name,
                 static_cast<double>(evidence.groups().size()),
                 searched.probability,
                 static_cast<double>(searched.is_right),
                 searched.of_right,
                 all.probability,
                 static_cast<double>(all.is_right),
                 all.of_right});
}

Status ExplainLayouts(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("layout-pairs", arguments.output, context.dry_run()));
  std::vector<std::vector<LayoutRun>> layouts;
  for (const int dataset : {1, 2}) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        layouts.emplace_back(),
        MapLayout(fmt::format("{}/MRCLAM_Dataset{}", arguments.data, dataset), dataset));
  }
  ResultTable table({"reference",
                     "other",
                     "landmarks",
                     "probability",
                     "is_right",
                     "probability_of_right",
                     "enumerated_probability",
                     "enumerated_is_right",
                     "enumerated_probability_of_right"});
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  const std::size_t pairs = 2 * layouts[0].size() * layouts[1].size();
  std::size_t done = 0;
  for (const std::size_t first : {0U, 1U}) {
    for (const LayoutRun& reference : layouts[first]) {
      for (const LayoutRun& other : layouts[1 - first]) {
        progress->Update(reference.name + ", " + other.name,
                         static_cast<double>(done++) / static_cast<double>(pairs));
        AddPair(reference, other, &table);
      }
    }
  }
  return output.Report(Json::object(), table, &context);
}

}  // namespace

void AddLayoutPairsExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand("layout-pairs",
                   "Frames that explain recorded runs in two layouts, by search and enumeration",
                   [arguments](Context& context) { return ExplainLayouts(*arguments, context); })
      .Option("--output", &arguments->output, "Folder for CSV and JSON")
      .Required()
      .Option("--data", &arguments->data, "Folder with MRCLAM_Dataset1 and MRCLAM_Dataset2")
      .Required()
      .Writes();
}

}  // namespace shiftmap
