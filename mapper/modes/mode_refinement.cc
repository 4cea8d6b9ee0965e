// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/mode_refinement.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <memory>
#include <set>
#include <utility>

#include "localizer/hypothesis/log_math.h"
#include "localizer/models/observation_model.h"
#include "mapper/modes/mode_merging.h"
#include "mapper/modes/unconstrained_runs.h"
#include "mapper/modes/visit_density.h"
#include "mapper/modes/visit_scatter.h"
#include "mapper/parallel.h"
#include "mapper/selection/selector.h"
#include "mapper/selection/visit_sequence.h"
#include "mapper/selection/viterbi.h"
#include "mapper/state/sightings.h"
#include "mapstore/map/mode_chain.h"
#include "mapstore/map/vehicle_records.h"

namespace shiftmap {
namespace {

// Everything discrete of a build, to notice that it comes around again.
std::vector<int> DiscreteState(const BuildState& build) {
  std::vector<int> state;
  for (const GroupModes& group : build.modes) state.push_back(static_cast<int>(group.size()));
  for (const BuildRun& run : build.runs) {
    for (const OptionalMode mode : run.assignment) state.push_back(StateOf(mode));
  }
  return state;
}

bool HasSeveralModes(const BuildState& build) {
  return std::any_of(build.modes.begin(), build.modes.end(), [](const GroupModes& group) {
    return group.size() > 1;
  });
}

// Selection as the options want it. A max-mixture is a factor whose component is chosen wherever it
// is linearized: after each step of the solver, until that changes no component.
void Select(const MapperOptions& options, BuildState* build) {
  if (options.modes.selector.kind != SelectorKind::kMaxMixture) {
    SelectModes(options.modes, build, options.threads);
    return;
  }
  MapperOptions one_step = options;
  one_step.solver.max_iterations = 1;
  for (int i = 0; i < options.solver.max_iterations; ++i) {
    if (SelectModes(options.modes, build, options.threads) == 0 && i > 0) return;
    SolveContinuous(one_step, build);
  }
}

// Selection is insensitive to small changes of residuals: a coarse solution will do.
MapperOptions ForSelection(const MapperOptions& options) {
  constexpr double kCostTolerance = 1e-4;
  MapperOptions coarse = options;
  coarse.max_integrations = 1;
  coarse.solver.cost_tolerance = std::max(kCostTolerance, options.solver.cost_tolerance);
  return coarse;
}

// Modes of one landmark that are the same.
// @param graph  Of the build, which the solver has just solved.
std::vector<ModeMerge> MergesIn(const ModeOptions& options,
                                const Graph& graph,
                                const BuildState& build,
                                GraphSolver* solver) {
  if (!HasSeveralModes(build)) return {};
  const auto differences = ModeDifferences::Of(graph, solver);
  return differences ? FindMerges(options, *differences, build) : std::vector<ModeMerge>();
}

// A build before modes were merged.
struct Unmerged {
  BuildState build;
  MergeMemory memory;
  std::vector<ModeMerge> merges;
};

// Whether the modes that were merged cannot all be one place each, though any of them can: as where
// half of the landmarks of a hall moved, which nothing else holds.
bool MergesContradict(const MapperOptions& options,
                      const Unmerged& before,
                      const BuildState& merged) {
  const double unsolved = 2.0 * options.solver.cost_tolerance * before.build.cost;
  return merged.cost >
         before.build.cost + unsolved + kModeCost * static_cast<double>(before.merges.size());
}

// The one of two modes that are nearest to each other.
ModeMerge NearestOf(const std::vector<ModeMerge>& merges, const BuildState& build) {
  return *std::ranges::min_element(merges, {}, [&](const ModeMerge& merge) {
    const GroupModes& modes = build.modes[merge.group];
    return (modes[merge.to].p_map_landmark - modes[merge.from].p_map_landmark).norm();
  });
}

// Selection, mode creation, the continuous part and merging in turn. Returns the alternations.
int Alternate(const MapperOptions& options,
              BuildState* build,
              GraphSolver* solver,
              const StepCallback& on_step) {
  std::set<std::vector<int>> seen;
  std::vector<int> solved;
  MergeMemory memory(*build);
  std::optional<Unmerged> unmerged;  // Of the last iteration.
  for (int iteration = 1; iteration <= options.max_outer_iterations; ++iteration) {
    if (build->runs.empty() || (on_step && !on_step(*build))) return iteration - 1;
    Select(options, build);
    CreateModes(options.modes, build);
    DropUnusedModes(build);
    memory.MergeAgain(build);
    if (RemoveUnconstrainedRuns(build) > 0) {
      memory = MergeMemory(*build);
      unmerged.reset();
      continue;
    }
    std::vector<int> state = DiscreteState(*build);
    if (state == solved) {
      const bool splits = build->placed() && options.modes.selector.kind == SelectorKind::kViterbi;
      if (!splits || SplitModes(options.modes, build, options.threads) == 0) return iteration;
      Select(options, build);
      DropUnusedModes(build);
      state = DiscreteState(*build);
    }
    // A state that comes again closes a cycle.
    bool recurs = !seen.insert(state).second;
    const Graph graph = SolveContinuous(options, build, solver);
    solved = state;
    std::vector<ModeMerge> merges;
    if (unmerged && MergesContradict(options, *unmerged, *build)) {
      seen.erase(state);  // It may come again.
      recurs = false;
      *build = std::move(unmerged->build);
      memory = std::move(unmerged->memory);
      merges = {NearestOf(unmerged->merges, *build)};
    } else {
      merges = MergesIn(options.modes, graph, *build, solver);
    }
    unmerged.reset();
    if (merges.size() > 1 && build->placed()) {
      const bool is_last = recurs || iteration == options.max_outer_iterations;
      if (is_last) {
        merges = {NearestOf(merges, *build)};
      } else {
        unmerged = {*build, memory, merges};
      }
    }
    build->modes_merged += static_cast<int>(merges.size());
    memory.Merge(merges, build);
    if (!merges.empty()) solved.clear();
    if (recurs) return iteration;
  }
  return options.max_outer_iterations;
}

// Where a group's landmark stands when its first visit begins, by what was known before. What was
// known may be a mistake. A mode that was not known is as likely as `absent`; one that was told
// apart together with other landmarks was decided then, and is as likely as the likeliest.
Eigen::VectorXd StartOf(const BuildState& build,
                        GroupIndex group,
                        const ModeChain& chain,
                        Stamp begin) {
  const LandmarkGroup* const known = build.Known(group);
  if (known == nullptr || begin < build.known_at) return chain.stationary();
  const GroupModes& modes = build.modes[group];
  Eigen::VectorXd start(chain.states());
  start(0) = known->probabilities(0);
  for (const GroupModeIndex k : modes.indices()) {
    start(StateOf(k)) = modes[k].displaced_to
                            ? known->probabilities.maxCoeff()
                            : known->probabilities(std::max(0, known->StateOf(modes[k].number)));
  }
  start =
      (1.0 - kMistakeProbability) * start / start.sum() + kMistakeProbability * chain.stationary();
  return chain.Propagate(start, build.known_at, begin);
}

// Covariance of the error of pose and map that a visit is scored with. [m²]
Eigen::Matrix2d PoseError(const ModeOptions& options) {
  return Eigen::Matrix2d::Identity() * (options.score_position_sd_m * options.score_position_sd_m);
}

// A mode in the prior map.
const Mode& KnownMode(const BuildState& build, GroupIndex group, ModeNumber number) {
  const LandmarkGroup& known = *build.Known(group);
  return known.modes[static_cast<std::size_t>(known.StateOf(number)) - 1];
}

using ModeCovariances = IndexedVector<GroupModeIndex, Eigen::Matrix2d>;

// Covariances of a group's modes in the prior map, without the common scale; zero of others. [m²]
ModeCovariances KnownCovariances(const BuildState& build, GroupIndex group) {
  ModeCovariances result;
  for (const BuildMode& mode : build.modes[group]) {
    result.push_back(mode.number == kAbsent
                         ? Eigen::Matrix2d(Eigen::Matrix2d::Zero())
                         : KnownMode(build, group, mode.number).cov_p_map_landmark);
  }
  return result;
}

// The same after the build's visits at a mode, each with the error of pose and map: a mode that was
// known badly has come to where they are.
ModeCovariances SolvedCovariances(const BuildState& build,
                                  const std::vector<VisitRef>& visits,
                                  GroupIndex group,
                                  const ModeOptions& options) {
  ModeCovariances result = KnownCovariances(build, group);
  IndexedVector<GroupModeIndex, int> count(result.size());
  for (const VisitRef& ref : visits) {
    if (const OptionalMode mode = AssignmentOf(build, ref)) ++count[*mode];
  }
  for (const GroupModeIndex k : result.indices()) {
    if (count[k] == 0) continue;
    const Eigen::Matrix2d of_visits = PoseError(options) / count[k];
    result[k] = of_visits * (result[k] + of_visits).inverse() * result[k];
  }
  return result;
}

// Before all runs are placed, the error of a pose may be of any size and differ from scan to scan:
// every sighting is scored by itself, which lets a run that does not fit stand out.
Eigen::VectorXd ScoreBySighting(const BuildState& build,
                                const VisitRef& ref,
                                const ModeOptions& options) {
  const MappingVisit& visit = VisitOf(build, ref);
  const BuildRun& run = build.runs[ref.run];
  const GroupModes& modes = build.modes[visit.group];
  const SensorCalibration& sensor = build.sensor;
  const Eigen::Matrix2d pose_noise = PoseError(options);

  Eigen::VectorXd result = Eigen::VectorXd::Zero(std::ssize(modes) + 1);
  for (const SightingIndex index : visit.sightings) {
    const Sighting& sighting = run.data->sightings[index];
    const Observation& observation = sighting.observation;
    const double area = SquareMetresPerUnit(observation);
    const double log_clutter = std::log(sensor.clutter_density_per_m2 * area);
    result[0] +=
        std::log((sensor.clutter_density_per_m2 + sensor.new_landmark_density_per_m2) * area);
    for (const GroupModeIndex k : modes.indices()) {
      const Innovation innovation = SightingInnovation(run, sighting, modes[k].p_map_landmark);
      const Eigen::Matrix2d S =
          ObservationNoise(observation, sensor) +
          innovation.H_landmark * pose_noise * innovation.H_landmark.transpose();
      const double log_detection =
          std::log(sensor.detection_probability) + LogGaussian(innovation.nu, S);
      result[StateOf(k)] += LogAdd(log_detection, log_clutter);
    }
  }
  return result;
}

VisitDensity DensityOf(const BuildState& build, const VisitRef& ref, const ModeOptions& options) {
  return {SeenPlaces(build, build.runs[ref.run], VisitOf(build, ref)),
          build.sensor,
          options.misread_density_per_m2,
          options.cluster_radius_m};
}

// The sightings of a visit share the error of pose and map.
Eigen::VectorXd ScoreJointly(const BuildState& build,
                             const VisitRef& ref,
                             const ModeCovariances& covariances,
                             const ModeOptions& options) {
  const MappingVisit& visit = VisitOf(build, ref);
  const GroupModes& modes = build.modes[visit.group];
  const VisitDensity density = DensityOf(build, ref, options);
  Eigen::VectorXd result(std::ssize(modes) + 1);
  result[0] = density.LogAbsent();
  for (const GroupModeIndex k : modes.indices()) {
    result[StateOf(k)] =
        density.LogUnderMode(modes[k].p_map_landmark, PoseError(options) + covariances[k]);
  }
  return result;
}

Eigen::VectorXd Score(const BuildState& build,
                      const VisitRef& ref,
                      const ModeCovariances& covariances,
                      const ModeOptions& options) {
  return build.placed() ? ScoreJointly(build, ref, covariances, options)
                        : ScoreBySighting(build, ref, options);
}

// Two places of a landmark for one mode of it.
struct Split {
  GroupModeIndex mode;
  Eigen::Vector2d p_mode;  // Where the visits that are nearer to the mode put it. [m]
  Eigen::Vector2d p_new;   // [m]
  VisitRef visit;          // That put it there.
};

// At the place of the visit that its mode explains worst, beside one at its own place. Nothing
// where places of their own would not gain all visits together what a new place costs.
std::optional<Split> WorstExplained(const ModeOptions& options,
                                    const BuildState& build,
                                    const std::vector<VisitRef>& visits,
                                    GroupIndex group) {
  struct Seen {
    VisitRef visit;
    GroupModeIndex mode;
    Eigen::Vector2d centre;
    double gain;
  };
  const Eigen::Matrix2d pose_error = PoseError(options);
  // What one at its own place, known to `score_position_sd_m`, gains on one at a new place.
  const double least_gain =
      -std::log(2.0 * M_PI * pose_error(0, 0) * build.sensor.new_landmark_density_per_m2);
  std::vector<Seen> seen;
  for (const VisitRef& ref : visits) {
    const OptionalMode mode = AssignmentOf(build, ref);
    if (!mode) continue;
    const VisitCluster cluster =
        ClusterOf(build.runs[ref.run], VisitOf(build, ref), options.cluster_radius_m);
    if (cluster.count < options.min_sightings) continue;
    const VisitDensity density = DensityOf(build, ref, options);
    const Eigen::Vector2d& p = build.modes[group][*mode].p_map_landmark;
    seen.push_back(
        {ref,
         *mode,
         cluster.centre,
         density.LogUnderMode(cluster.centre, pose_error) - density.LogUnderMode(p, pose_error)});
  }
  double gains = 0.0;
  for (const Seen& visit : seen) gains += std::max(0.0, visit.gain);
  if (gains <= least_gain) return std::nullopt;
  const Seen& worst = *std::max_element(
      seen.begin(), seen.end(), [](const Seen& a, const Seen& b) { return a.gain < b.gain; });
  const BuildMode& mode = build.modes[group][worst.mode];
  Split split{worst.mode, mode.p_map_landmark, worst.centre, worst.visit};
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  int nearer = 0;
  for (const Seen& other : seen) {
    const double to_mode = (other.centre - mode.p_map_landmark).norm();
    if (other.mode != worst.mode || (other.centre - worst.centre).norm() < to_mode) continue;
    sum += other.centre;
    ++nearer;
  }
  if (nearer == 0) return split;
  split.p_mode = sum / nearer;
  if (mode.number == kAbsent) return split;
  const Mode& known = KnownMode(build, group, mode.number);
  const Eigen::Matrix2d of_visits = pose_error / nearer;
  split.p_mode += of_visits * (known.cov_p_map_landmark + of_visits).inverse() *
                  (known.p_map_landmark - split.p_mode);
  return split;
}

// Visits that share less than is assumed tell places apart that are nearer to each other.
ModeOptions ForSplits(const ModeOptions& options, const BuildState& build, int threads) {
  ModeOptions result = options;
  const double shared_sd_m = std::sqrt(SharedVisitVariance(options, build, threads));
  result.score_position_sd_m =
      std::min(options.score_position_sd_m, std::max(options.position_floor_m, shared_sd_m));
  return result;
}

ModeSequenceProblem SequenceOf(const BuildState& build,
                               const std::vector<VisitRef>& visits,
                               GroupIndex group,
                               const ModeChain& chain,
                               const ModeOptions& options) {
  const ModeCovariances covariances = SolvedCovariances(build, visits, group, options);
  std::vector<VisitStep> steps;
  for (const VisitRef& ref : visits) {
    const MappingVisit& visit = VisitOf(build, ref);
    steps.push_back({Score(build, ref, covariances, options), visit.begin, visit.end});
  }
  const Eigen::VectorXd start = StartOf(build, group, chain, VisitOf(build, visits.front()).begin);
  ModeSequenceProblem sequence = MakeVisitSequence(start.array().log(), chain, steps);
  sequence.static_state = std::min(1, chain.states() - 1);
  return sequence;
}

// Under a uniform chain: one that was learned says nothing of a further mode.
double BestLogJoint(const ModeOptions& options,
                    const BuildState& build,
                    const std::vector<VisitRef>& visits,
                    GroupIndex group) {
  const ModeChain uniform = ModeChain::Uniform(static_cast<int>(build.modes[group].size()),
                                               ChainOf(build, group, options).leave_rate_per_s());
  const ModeSequenceProblem sequence = SequenceOf(build, visits, group, uniform, options);
  return LogJoint(sequence, MostLikelyModes(sequence));
}

}  // namespace

ModeChain ChainOf(const BuildState& build, GroupIndex group, const ModeOptions& options) {
  const auto modes = static_cast<int>(build.modes[group].size());
  const LandmarkGroup* const known = build.Known(group);
  if (known == nullptr) return ModeChain::Uniform(modes, options.leave_rate_per_s);
  const ModeChain& chain = known->chain;
  return chain.states() == modes + 1 ? chain : ModeChain::Uniform(modes, chain.leave_rate_per_s());
}

Eigen::VectorXd VisitLogLikelihood(const BuildState& build,
                                   const VisitRef& ref,
                                   const ModeOptions& options) {
  return Score(build, ref, KnownCovariances(build, VisitOf(build, ref).group), options);
}

ModeSequenceProblem MakeGroupSequence(const BuildState& build,
                                      const std::vector<VisitRef>& visits,
                                      GroupIndex group,
                                      const ModeOptions& options) {
  return SequenceOf(build, visits, group, ChainOf(build, group, options), options);
}

int SelectModes(const ModeOptions& options, BuildState* build, int threads) {
  int changed = 0;
  const std::unique_ptr<Selector> selector = MakeSelector(options.selector);
  const auto by_group = VisitsByGroup(*build);
  IndexedVector<GroupIndex, ModeSequenceProblem> sequences(by_group.size());
  ForEachIndex(by_group.size(), threads, [&](std::size_t i) {
    const GroupIndex group(i);
    if (by_group[group].empty()) return;
    sequences[group] = MakeGroupSequence(*build, by_group[group], group, options);
  });
  for (const GroupIndex group : by_group.indices()) {
    const std::vector<VisitRef>& visits = by_group[group];
    if (visits.empty()) continue;
    const std::vector<int> states = selector->Select(sequences[group]).states;
    for (std::size_t t = 0; t < visits.size(); ++t) {
      OptionalMode& assignment = AssignmentOf(build, visits[t]);
      const OptionalMode selected = ModeOfState(states[t]);
      changed += assignment != selected;
      assignment = selected;
    }
  }
  return changed;
}

int CreateModes(const ModeOptions& options, BuildState* build) {
  int created = 0;
  const auto by_group = VisitsByGroup(*build);
  for (const GroupIndex group : by_group.indices()) {
    const GroupModes& modes = build->modes[group];
    const GroupModeIndex known = modes.end_index();
    for (const VisitRef& ref : by_group[group]) {
      if (AssignmentOf(build, ref)) continue;
      const VisitCluster cluster =
          ClusterOf(build->runs[ref.run], VisitOf(*build, ref), options.cluster_radius_m);
      if (cluster.count < options.min_sightings) continue;
      // An earlier visit may just have made a mode of this place.
      OptionalMode mode;
      for (GroupModeIndex k = known; k < modes.end_index() && !mode; ++k) {
        const double distance = (modes[k].p_map_landmark - cluster.centre).norm();
        if (distance < 2.0 * options.cluster_radius_m) mode = k;
      }
      if (!mode) {
        mode = AddMode(group, {cluster.centre, kAbsent}, build);
        ++created;
      }
      AssignmentOf(build, ref) = mode;
    }
  }
  return created;
}

int SplitModes(const ModeOptions& of_selection, BuildState* build, int threads) {
  const ModeOptions options = ForSplits(of_selection, *build, threads);
  int created = 0;
  const auto by_group = VisitsByGroup(*build);
  IndexedVector<GroupIndex, std::optional<Split>> splits(by_group.size());
  ForEachIndex(by_group.size(), threads, [&](std::size_t i) {
    const GroupIndex group(i);
    splits[group] = WorstExplained(options, *build, by_group[group], group);
  });
  for (const GroupIndex group : by_group.indices()) {
    const std::optional<Split>& split = splits[group];
    if (!split) continue;
    const std::vector<VisitRef>& visits = by_group[group];
    const double before = BestLogJoint(options, *build, visits, group);
    const int state = StateOf(AddMode(group, {split->p_new, kAbsent}, build));
    Eigen::Vector2d& p_mode = build->modes[group][split->mode].p_map_landmark;
    const Eigen::Vector2d p_before = std::exchange(p_mode, split->p_mode);
    const Eigen::VectorXd of_visit = VisitLogLikelihood(*build, split->visit, options);
    // The visit that the place is taken from found something new.
    const double after =
        BestLogJoint(options, *build, visits, group) - of_visit[state] + of_visit[0];
    if (after > before) {
      AssignmentOf(build, split->visit) = ModeOfState(state);
      ++created;
    } else {
      p_mode = p_before;
    }
  }
  DropUnusedModes(build);
  return created;
}

int RefineModes(const MapperOptions& options,
                BuildState* build,
                GraphSolver* solver,
                const StepCallback& on_step) {
  const int iterations = AlternateModes(options, build, solver, on_step);
  if (!build->runs.empty()) SolveContinuous(options, build, solver);
  return iterations;
}

int AlternateModes(const MapperOptions& options,
                   BuildState* build,
                   GraphSolver* solver,
                   const StepCallback& on_step) {
  return Alternate(ForSelection(options), build, solver, on_step);
}

void UpdateModes(const MapperOptions& options, BuildState* build, const StepCallback& on_step) {
  constexpr int kAlternations = 2;
  constexpr int kIterations = 5;
  constexpr double kCostTolerance = 1e-3;
  MapperOptions coarse = options;
  coarse.max_outer_iterations = std::min(kAlternations, options.max_outer_iterations);
  coarse.max_integrations = 1;
  coarse.solver.max_iterations = std::min(kIterations, options.solver.max_iterations);
  coarse.solver.cost_tolerance = std::max(kCostTolerance, options.solver.cost_tolerance);
  GraphSolver solver;
  Alternate(coarse, build, &solver, on_step);
}

}  // namespace shiftmap
