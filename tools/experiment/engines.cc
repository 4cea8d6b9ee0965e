// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/engines.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "mapper/frontend/mapping_run.h"
#include "mapper/mapper.h"
#include "mapper/tree/tree_builder.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/run/trajectory.h"
#include "tools/eval/map_error.h"
#include "tools/eval/trajectory_error.h"
#include "tools/experiment/processor_time.h"
#include "tools/sim/mine_world.h"
#include "tools/sim/open_world.h"

namespace shiftmap {
namespace {

// Modes and places of one landmark this near to each other are one. [m]
constexpr double kSameM = 0.5;

// A place with so many sightings in a visit is a mode; one with fewer may be.
constexpr int kSurelyMode = 4;

// A place of a landmark that was seen, or a mode of the map that another one is held against.
struct Place {
  Signature signature;
  Eigen::Vector2d p = Eigen::Vector2d::Zero();  // [m]
  bool wanted = true;
};

// A mode of a map beside its place.
struct Match {
  const LandmarkGroup* group = nullptr;
  const Mode* mode = nullptr;
  std::size_t place = 0;
  Eigen::Vector2d error = Eigen::Vector2d::Zero();  // In the map's frame. [m]
};

struct Matching {
  std::vector<Match> matches;
  Se2 T_place_map;
};

OpenWorldOptions Floor(int groups, double size_m, int runs, double change_probability) {
  OpenWorldOptions options;
  options.groups = groups;
  options.size_m = size_m;
  options.runs = runs;
  options.mode_change_probability = change_probability;
  return options;
}

const std::map<std::string, OpenWorldOptions>& Floors() {
  static const auto* const floors = [] {
    auto* const all =
        new std::map<std::string, OpenWorldOptions>{{"three-shifts", Floor(20, 25.0, 3, 0.25)},
                                                    {"half-moves", Floor(20, 25.0, 3, 0.5)},
                                                    {"six-shifts", Floor(20, 30.0, 6, 0.25)},
                                                    {"wide-half-moves", Floor(20, 40.0, 6, 0.5)},
                                                    {"false-alarms", Floor(20, 30.0, 4, 0.25)},
                                                    {"large", Floor(60, 60.0, 4, 0.25)}};
    all->at("false-alarms").clutter_per_scan = 0.05;
    all->at("false-alarms").absent_probability = 0.1;
    all->at("large").duration_s = 600.0;
    return all;
  }();
  return *floors;
}

constexpr const char* kMine = "mine";

using SeenPlace = std::pair<std::size_t, int>;  // Group, and number of its mode.

// The most sightings that a visit of the run has of a place.
void CountSightings(const SimulatedWorld& world,
                    const SimulatedRun& run,
                    const FrontEndOptions& options,
                    std::map<SeenPlace, int>* most) {
  std::vector<Signature> signatures;
  for (const SimulatedGroup& group : world.groups) signatures.push_back(group.signature);
  const MappingRun mapping = MakeMappingRun(run.run, signatures, options);
  for (const MappingVisit& visit : mapping.visits) {
    const auto group = static_cast<std::size_t>(visit.group.value());
    const ModeNumber active = run.active_mode[group];
    if (active == kAbsent) continue;
    int& sightings = (*most)[{group, active.value()}];
    sightings = std::max(sightings, static_cast<int>(visit.sightings.size()));
  }
}

// Places that landmarks were seen at.
std::vector<Place> SeenPlaces(const SimulatedWorld& world, const FrontEndOptions& options) {
  std::map<SeenPlace, int> most;
  for (const SimulatedRun& run : world.runs) CountSightings(world, run, options, &most);
  std::vector<Place> places;
  for (const auto& [key, sightings] : most) {
    const SimulatedGroup& group = world.groups[key.first];
    places.push_back({group.signature,
                      group.modes[static_cast<std::size_t>(key.second) - 1],
                      sightings >= kSurelyMode});
  }
  return places;
}

std::vector<Place> ModesOf(const MapContent& content) {
  std::vector<Place> places;
  for (const LandmarkGroup& group : content.groups) {
    for (const Mode& mode : group.modes) places.push_back({group.signature, mode.p_map_landmark});
  }
  return places;
}

// Modes and places of one landmark, nearest first, each once.
StatusOr<Matching> MatchPlaces(const MapContent& content, const std::vector<Place>& places) {
  std::vector<TruePlace> truth;
  for (const Place& place : places) truth.push_back({place.signature, place.p});
  SHIFTMAP_ASSIGN_OR_RETURN(const MapError fit, EvaluateMap(content.groups, truth, true));
  std::vector<std::pair<double, Match>> candidates;
  for (const LandmarkGroup& group : content.groups) {
    for (const Mode& mode : group.modes) {
      for (std::size_t i = 0; i < places.size(); ++i) {
        if (places[i].signature != group.signature) continue;
        const double apart_m = (fit.T_truth_map * mode.p_map_landmark - places[i].p).norm();
        if (apart_m < kSameM) candidates.push_back({apart_m, {&group, &mode, i}});
      }
    }
  }
  std::stable_sort(candidates.begin(), candidates.end(), [](const auto& a, const auto& b) {
    return a.first < b.first;
  });
  std::set<const Mode*> modes;
  std::set<std::size_t> taken;
  Matching matching;
  std::vector<PointPair> pairs;
  for (const auto& [apart_m, match] : candidates) {
    if (modes.contains(match.mode) || taken.contains(match.place)) continue;
    modes.insert(match.mode);
    taken.insert(match.place);
    matching.matches.push_back(match);
    pairs.push_back({places[match.place].p, match.mode->p_map_landmark});
  }
  SHIFTMAP_ASSIGN_OR_RETURN(matching.T_place_map, AlignRigid2d(pairs));
  const Se2 T_map_place = matching.T_place_map.Inverse();
  for (Match& match : matching.matches) {
    match.error = match.mode->p_map_landmark - T_map_place * places[match.place].p;
  }
  return matching;
}

int ModesOf(const MapContent& content, const Signature& signature) {
  for (const LandmarkGroup& group : content.groups) {
    if (group.signature == signature) return static_cast<int>(group.modes.size());
  }
  return 0;
}

void ScoreModes(const MapContent& content,
                const std::vector<Place>& places,
                const Matching& matching,
                const std::vector<SimulatedGroup>& groups,
                EngineScore* score) {
  std::map<Signature, int> matched;
  std::set<std::size_t> found;
  for (const Match& match : matching.matches) {
    ++matched[match.group->signature];
    found.insert(match.place);
    ++score->matched;
    score->squared_m2 += match.error.squaredNorm();
    score->squared_deviations += SquaredMahalanobis(match.error, match.mode->cov_p_map_landmark);
  }
  std::map<Signature, int> missing;
  std::set<Signature> seen;
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (places[i].wanted) seen.insert(places[i].signature);
    missing[places[i].signature] += places[i].wanted && !found.contains(i);
  }
  for (const SimulatedGroup& group : groups) {
    const int modes = ModesOf(content, group.signature);
    const int spurious = modes - matched[group.signature];
    score->modes += modes;
    score->spurious += spurious;
    score->missing += missing[group.signature];
    const bool counts = seen.contains(group.signature) || modes > 0;
    score->groups_right += counts && spurious == 0 && missing[group.signature] == 0;
  }
}

// Poses in the frame of the truth at scans that saw something. The tree engine has poses where
// nothing was seen as well.
std::vector<StampedPose> PosesThatSee(const std::vector<StampedPose>& trajectory,
                                      const Run& run,
                                      const Se2& T_truth_map) {
  std::vector<StampedPose> poses;
  auto scan = run.scans.begin();
  for (const StampedPose& pose : trajectory) {
    while (scan != run.scans.end() && scan->stamp < pose.stamp) ++scan;
    if (scan == run.scans.end() || scan->observations.empty()) continue;
    poses.push_back({pose.stamp, T_truth_map * pose.T_map_vehicle});
  }
  return poses;
}

Status ScoreTrajectories(const MapperResult& result,
                         const Se2& T_truth_map,
                         const SimulatedWorld& world,
                         EngineScore* score) {
  for (const MappedRun& run : result.runs) {
    const auto index = static_cast<std::size_t>(std::stoi(run.name));
    const std::vector<StampedPose> poses =
        PosesThatSee(run.trajectory, world.runs[index].run, T_truth_map);
    SHIFTMAP_ASSIGN_OR_RETURN(const TrajectoryError error,
                              EvaluateTrajectory(poses, world.runs[index].truth, {}));
    score->poses += error.matched;
    score->squared_of_poses_m2 += error.matched * error.position_rmse_m * error.position_rmse_m;
  }
  return OkStatus();
}

// The difference of two maps by landmark, and what of it is an exception.
void CompareModes(const SimulatedWorld& world,
                  const std::vector<Place>& places,
                  const MapContent& graph,
                  const MapContent& tree,
                  const Matching& matching,
                  EnginesRow* row,
                  std::vector<EnginesException>* exceptions) {
  static const double ellipse39 = ChiSquareQuantile(1.0 - std::exp(-0.5), 2);
  static const double ellipse95 = ChiSquareQuantile(0.95, 2);
  EngineDifference& difference = row->difference;
  std::map<Signature, EnginesException> groups;
  for (const SimulatedGroup& group : world.groups) {
    EnginesException& landmark = groups[group.signature];
    landmark = {row->kind, row->seed, group.signature};
    landmark.graph_modes = ModesOf(graph, group.signature);
    landmark.tree_modes = ModesOf(tree, group.signature);
  }
  for (const Place& place : places) {
    groups[place.signature].true_modes += place.wanted;
    ++groups[place.signature].seen_places;
  }
  for (const Match& match : matching.matches) {
    const Eigen::Matrix2d& cov = match.mode->cov_p_map_landmark;
    const double squared = SquaredMahalanobis(match.error, cov);
    ++difference.matched;
    difference.squared_m2 += match.error.squaredNorm();
    for (int axis = 0; axis < 2; ++axis) {
      difference.axes_within_sd += std::abs(match.error[axis]) <= std::sqrt(cov(axis, axis));
    }
    difference.within_ellipse39 += squared <= ellipse39;
    difference.within_ellipse95 += squared <= ellipse95;
    EnginesException& landmark = groups[match.group->signature];
    landmark.apart_m = std::max(landmark.apart_m, match.error.norm());
    landmark.deviations = std::max(landmark.deviations, std::sqrt(squared));
  }
  for (const auto& [signature, landmark] : groups) {
    if (landmark.true_modes == 0 && landmark.graph_modes == 0 && landmark.tree_modes == 0) continue;
    ++difference.groups;
    difference.same_number += landmark.graph_modes == landmark.tree_modes;
    const auto differs = [&, &l = landmark](int modes) {
      return modes < l.true_modes || modes > l.seen_places;
    };
    if (landmark.graph_modes != landmark.tree_modes || differs(landmark.graph_modes) ||
        landmark.deviations * landmark.deviations > ellipse95) {
      exceptions->push_back(landmark);
    }
  }
}

using Build = std::function<StatusOr<MapperResult>(std::vector<MapperInput>)>;

StatusOr<MapperResult> BuildTimed(const SimulatedWorld& world,
                                  const Build& build,
                                  EngineScore* score) {
  std::vector<MapperInput> inputs;
  for (std::size_t i = 0; i < world.runs.size(); ++i) {
    inputs.push_back({std::to_string(i), fmt::format("{:064x}", i), world.runs[i].run});
  }
  const auto begin = std::chrono::steady_clock::now();
  const double processor = ProcessorSeconds();
  SHIFTMAP_ASSIGN_OR_RETURN(MapperResult result, build(std::move(inputs)));
  score->processor_s = ProcessorSeconds() - processor;
  score->wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  score->left_out = static_cast<int>(world.runs.size() - result.runs.size());
  return result;
}

Status Score(const SimulatedWorld& world,
             const std::vector<Place>& places,
             const MapperResult& result,
             EngineScore* score) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Matching matching, MatchPlaces(result.content, places));
  ScoreModes(result.content, places, matching, world.groups, score);
  return ScoreTrajectories(result, matching.T_place_map, world, score);
}

}  // namespace

void EngineScore::Add(const EngineScore& other) {
  for (int EngineScore::*count : {&EngineScore::modes,
                                  &EngineScore::groups_right,
                                  &EngineScore::missing,
                                  &EngineScore::spurious,
                                  &EngineScore::matched,
                                  &EngineScore::poses,
                                  &EngineScore::left_out}) {
    this->*count += other.*count;
  }
  for (double EngineScore::*sum : {&EngineScore::squared_m2,
                                   &EngineScore::squared_deviations,
                                   &EngineScore::squared_of_poses_m2,
                                   &EngineScore::processor_s,
                                   &EngineScore::wall_s}) {
    this->*sum += other.*sum;
  }
}

void EngineDifference::Add(const EngineDifference& other) {
  for (int EngineDifference::*count : {&EngineDifference::groups,
                                       &EngineDifference::same_number,
                                       &EngineDifference::matched,
                                       &EngineDifference::axes_within_sd,
                                       &EngineDifference::within_ellipse39,
                                       &EngineDifference::within_ellipse95}) {
    this->*count += other.*count;
  }
  squared_m2 += other.squared_m2;
}

void EnginesRow::Add(const EnginesRow& other) {
  runs += other.runs;
  difference.Add(other.difference);
  graph.Add(other.graph);
  tree.Add(other.tree);
}

const std::vector<std::string>& EngineSiteKinds() {
  static const auto* const kinds = new std::vector<std::string>{"three-shifts",
                                                                "half-moves",
                                                                "six-shifts",
                                                                "wide-half-moves",
                                                                "false-alarms",
                                                                "large",
                                                                kMine};
  return *kinds;
}

StatusOr<SimulatedWorld> DrawEngineSite(const std::string& kind, std::uint64_t seed) {
  if (kind == kMine) {
    MineWorldOptions options;
    options.seed = seed;
    SHIFTMAP_ASSIGN_OR_RETURN(MineWorld mine, SimulateMine(options));
    return std::move(mine.world);
  }
  const auto floor = Floors().find(kind);
  if (floor == Floors().end()) return InvalidArgument("no kind of site '{}'", kind);
  OpenWorldOptions options = floor->second;
  options.seed = seed;
  return SimulateOpen(options);
}

Status CompareEngines(const std::string& kind,
                      std::uint64_t seed,
                      const SimulatedWorld& world,
                      EnginesResult* result) {
  MapperOptions options;
  options.sd_range_scale = 0.0;
  options.sd_run_range_scale = 1e-6;
  EnginesRow row{kind, seed, static_cast<int>(world.runs.size()), {}, {}, {}};
  SHIFTMAP_ASSIGN_OR_RETURN(
      const MapperResult graph,
      BuildTimed(
          world,
          [&](auto inputs) { return BuildMap(std::move(inputs), std::nullopt, options); },
          &row.graph));
  SHIFTMAP_ASSIGN_OR_RETURN(
      const MapperResult tree,
      BuildTimed(
          world,
          [&](auto inputs) { return BuildMapByTree(std::move(inputs), std::nullopt, options, {}); },
          &row.tree));
  const std::vector<Place> places = SeenPlaces(world, options.front_end);
  SHIFTMAP_RETURN_IF_ERROR(Score(world, places, graph, &row.graph));
  SHIFTMAP_RETURN_IF_ERROR(Score(world, places, tree, &row.tree));
  SHIFTMAP_ASSIGN_OR_RETURN(const Matching matching,
                            MatchPlaces(tree.content, ModesOf(graph.content)));
  CompareModes(world, places, graph.content, tree.content, matching, &row, &result->exceptions);
  result->sites.push_back(std::move(row));
  return OkStatus();
}

StatusOr<EnginesResult> RunEngines(const EnginesOptions& options,
                                   const std::function<void(double)>& progress) {
  EnginesResult result;
  const double sites = static_cast<double>(options.kinds.size()) * options.sites;
  for (const std::string& kind : options.kinds) {
    for (int i = 0; i < options.sites; ++i) {
      const std::uint64_t seed = options.seed + static_cast<std::uint64_t>(i);
      progress(static_cast<double>(result.sites.size()) / sites);
      SHIFTMAP_ASSIGN_OR_RETURN(const SimulatedWorld world, DrawEngineSite(kind, seed));
      SHIFTMAP_RETURN_IF_ERROR(CompareEngines(kind, seed, world, &result));
    }
  }
  return result;
}

}  // namespace shiftmap
