// SPDX-License-Identifier: Apache-2.0
#include "mapper/mode_refinement.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <set>
#include <utility>

#include "localizer/hypothesis/log_math.h"
#include "localizer/models/observation_model.h"
#include "mapper/parallel.h"
#include "mapper/selection/selector.h"
#include "mapper/selection/sequence_builders.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/mode_chain.h"

namespace shiftmap {
namespace {

const MappingVisit& VisitOf(const MapProblem& problem, const VisitRef& ref) {
  return problem.runs[static_cast<std::size_t>(ref.run)]
      .data->visits[static_cast<std::size_t>(ref.visit)];
}

int& AssignmentOf(MapProblem* problem, const VisitRef& ref) {
  return problem->runs[static_cast<std::size_t>(ref.run)]
      .assignment[static_cast<std::size_t>(ref.visit)];
}

// Everything discrete of a problem, to notice that it comes around again.
std::vector<int> DiscreteState(const MapProblem& problem) {
  std::vector<int> state;
  for (const std::vector<BuildMode>& group : problem.modes)
    state.push_back(static_cast<int>(group.size()));
  for (const BuildRun& run : problem.runs)
    state.insert(state.end(), run.assignment.begin(), run.assignment.end());
  return state;
}

// The same of one group.
std::vector<int> DiscreteState(const MapProblem& problem,
                               const std::vector<VisitRef>& visits,
                               std::size_t group) {
  std::vector<int> state = {static_cast<int>(problem.modes[group].size())};
  for (const VisitRef& ref : visits) {
    state.push_back(problem.runs[static_cast<std::size_t>(ref.run)]
                        .assignment[static_cast<std::size_t>(ref.visit)]);
  }
  return state;
}

// Moves every assignment of a group from one mode to another.
void Reassign(const std::vector<VisitRef>& visits, int from, int to, MapProblem* problem) {
  for (const VisitRef& ref : visits) {
    int& assignment = AssignmentOf(problem, ref);
    if (assignment == from) assignment = to;
  }
}

// Removes a mode; later modes of the group and of the prior's flat list move up.
void EraseMode(const std::vector<VisitRef>& visits,
               std::size_t group,
               int mode,
               MapProblem* problem) {
  if (!problem->prior.modes.empty()) {
    const int flat = FlatModes(*problem).Index(static_cast<int>(group), mode);
    for (int& index : problem->prior.modes) index -= index > flat ? 1 : 0;
  }
  problem->modes[group].erase(problem->modes[group].begin() + mode);
  for (const VisitRef& ref : visits) {
    int& assignment = AssignmentOf(problem, ref);
    if (assignment > mode) --assignment;
  }
}

bool HasSeveralModes(const MapProblem& problem) {
  return std::any_of(problem.modes.begin(),
                     problem.modes.end(),
                     [](const std::vector<BuildMode>& group) { return group.size() > 1; });
}

// What is known no better than this may be anywhere: that two modes are near each other is then no
// sign that they are one place. [m]
constexpr double kMaxMergeSd = 4.0;

// True if two modes i and j, `difference` apart, are not known to be one place.
// @param floor  Variance per axis beyond what their covariance knows of. [m²]
bool ToldApart(const Eigen::Vector2d& difference,
               int i,
               int j,
               double floor,
               double gate,
               const ModeDifferences& differences) {
  const auto unknown = [](const Eigen::Matrix2d& cov) {
    return 0.5 * cov.trace() > kMaxMergeSd * kMaxMergeSd;
  };
  const auto apart_by = [&](const Eigen::Matrix2d& cov) {
    return SquaredMahalanobis(difference, cov + floor * Eigen::Matrix2d::Identity()) > gate;
  };
  // What the least or the largest covariance there can be decides needs no other.
  const Eigen::Matrix2d least = differences.MinCovariance(i, j);
  const Eigen::Matrix2d most = differences.MaxCovariance(i, j);
  if (unknown(least)) return true;
  if (!unknown(most)) {
    if (!apart_by(least)) return false;
    if (apart_by(most)) return true;
  }
  const Eigen::Matrix2d cov = differences.Covariance(i, j);
  return unknown(cov) || apart_by(cov);
}

bool InPrior(const BuildMode& mode) { return mode.number != kAbsent; }

// Selection as the options want it. A max-mixture is a factor whose component is chosen wherever it
// is linearized: after each step of the solver, until that changes no component.
void Select(const MapperOptions& options, MapProblem* problem) {
  if (options.modes.selector.kind != SelectorKind::kMaxMixture) {
    SelectModes(options.modes, problem, options.threads);
    return;
  }
  MapperOptions one_step = options;
  one_step.max_solver_iterations = 1;
  for (int i = 0; i < options.max_solver_iterations; ++i) {
    if (SelectModes(options.modes, problem, options.threads) == 0 && i > 0) return;
    SolveContinuous(one_step, problem);
  }
}

// Two modes of a group that are one place: the second becomes the first.
struct ModeMerge {
  std::size_t group = 0;
  int to = 0;
  int from = 0;
};

std::vector<ModeMerge> FindMerges(const ModeOptions& options,
                                  const ModeDifferences& differences,
                                  const MapProblem& problem) {
  const double floor = 2.0 * options.position_floor_m * options.position_floor_m;
  const double gate = ChiSquareQuantile(options.merge_probability, 2);
  const FlatModes flat(problem);
  std::vector<ModeMerge> merges;
  for (std::size_t group = 0; group < problem.modes.size(); ++group) {
    const std::vector<BuildMode>& modes = problem.modes[group];
    std::vector<bool> gone(modes.size());
    for (std::size_t a = 0; a < modes.size(); ++a) {
      for (std::size_t b = a + 1; b < modes.size(); ++b) {
        if (gone[a] || gone[b] || InPrior(modes[b])) continue;
        if (InPrior(modes[a]) && modes[b].displaced) continue;
        const Eigen::Vector2d difference = modes[a].p_map_landmark - modes[b].p_map_landmark;
        const int i = flat.Index(static_cast<int>(group), static_cast<int>(a));
        const int j = flat.Index(static_cast<int>(group), static_cast<int>(b));
        if (ToldApart(difference, i, j, floor, gate, differences)) continue;
        merges.push_back({group, static_cast<int>(a), static_cast<int>(b)});
        gone[b] = true;
      }
    }
  }
  return merges;
}

void Merge(const std::vector<std::vector<VisitRef>>& by_group,
           const std::vector<ModeMerge>& merges,
           MapProblem* problem) {
  for (const ModeMerge& merge : merges) {
    Reassign(by_group[merge.group], merge.from, merge.to, problem);
  }
  DropUnusedModes(problem);
}

// Remembers which modes of a group were merged in which of its states. A visit that is told apart
// from a mode by its likelihood, but whose mode is not, would have it made and merged for ever.
class MergeMemory {
 public:
  explicit MergeMemory(const MapProblem& problem)
      : by_group_(VisitsByGroup(problem)), merged_(by_group_.size()) {}

  // Merges modes, and will again.
  void Merge(const std::vector<ModeMerge>& merges, MapProblem* problem) {
    std::size_t last = by_group_.size();
    for (const ModeMerge& merge : merges) {
      const std::size_t group = merge.group;
      if (std::exchange(last, group) != group) {
        state_ = DiscreteState(*problem, by_group_[group], group);
        merged_[group][state_].clear();
      }
      merged_[group][state_].push_back(merge);
    }
    shiftmap::Merge(by_group_, merges, problem);
  }

  // Merges what was merged before in groups that are in a state as then.
  void MergeAgain(MapProblem* problem) const {
    std::vector<ModeMerge> merges;
    for (std::size_t group = 0; group < by_group_.size(); ++group) {
      if (merged_[group].empty()) continue;
      const auto found = merged_[group].find(DiscreteState(*problem, by_group_[group], group));
      if (found == merged_[group].end()) continue;
      merges.insert(merges.end(), found->second.begin(), found->second.end());
    }
    shiftmap::Merge(by_group_, merges, problem);
  }

 private:
  std::vector<std::vector<VisitRef>> by_group_;
  std::vector<std::map<std::vector<int>, std::vector<ModeMerge>>> merged_;  // Per group, by state.
  std::vector<int> state_;                                                  // Of the group at hand.
};

}  // namespace

std::vector<std::vector<VisitRef>> VisitsByGroup(const MapProblem& problem) {
  std::vector<std::vector<VisitRef>> by_group(problem.signatures.size());
  for (std::size_t r = 0; r < problem.runs.size(); ++r) {
    const std::vector<MappingVisit>& visits = problem.runs[r].data->visits;
    for (std::size_t v = 0; v < visits.size(); ++v) {
      by_group[static_cast<std::size_t>(visits[v].group)].push_back(
          {static_cast<int>(r), static_cast<int>(v)});
    }
  }
  for (std::vector<VisitRef>& visits : by_group) {
    std::stable_sort(visits.begin(), visits.end(), [&](const VisitRef& a, const VisitRef& b) {
      return VisitOf(problem, a).begin < VisitOf(problem, b).begin;
    });
  }
  return by_group;
}

Eigen::VectorXd VisitLogLikelihood(const MapProblem& problem,
                                   const VisitRef& ref,
                                   const ModeOptions& options) {
  const MappingVisit& visit = VisitOf(problem, ref);
  const BuildRun& run = problem.runs[static_cast<std::size_t>(ref.run)];
  const std::vector<BuildMode>& modes = problem.modes[static_cast<std::size_t>(visit.group)];
  const SensorCalibration& sensor = problem.sensor;
  const Eigen::Matrix2d pose_noise =
      Eigen::Matrix2d::Identity() * (options.score_position_sd_m * options.score_position_sd_m);

  Eigen::VectorXd result = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(modes.size()) + 1);
  for (const int index : visit.sightings) {
    const Sighting& sighting = run.data->sightings[static_cast<std::size_t>(index)];
    const Observation& observation = sighting.observation;
    const double area = SquareMetresPerUnit(observation);
    const double log_clutter = std::log(sensor.clutter_density_per_m2 * area);
    result[0] +=
        std::log((sensor.clutter_density_per_m2 + sensor.new_landmark_density_per_m2) * area);
    for (std::size_t k = 0; k < modes.size(); ++k) {
      const Innovation innovation = SightingInnovation(run, sighting, modes[k].p_map_landmark);
      const Eigen::Matrix2d S =
          ObservationNoise(observation, sensor) +
          innovation.H_landmark * pose_noise * innovation.H_landmark.transpose();
      const double log_detection =
          std::log(sensor.detection_probability) + LogGaussian(innovation.nu, S);
      result[static_cast<Eigen::Index>(k) + 1] += LogAdd(log_detection, log_clutter);
    }
  }
  return result;
}

ModeSequenceProblem MakeGroupSequence(const MapProblem& problem,
                                      const std::vector<VisitRef>& visits,
                                      std::size_t group,
                                      const ModeOptions& options) {
  const auto modes = static_cast<int>(problem.modes[group].size());
  std::vector<VisitStep> steps;
  for (std::size_t t = 0; t < visits.size(); ++t) {
    VisitStep step{VisitLogLikelihood(problem, visits[t], options), {}};
    if (t > 0) step.gap = VisitOf(problem, visits[t]).begin - VisitOf(problem, visits[t - 1]).end;
    steps.push_back(std::move(step));
  }
  ModeSequenceProblem sequence =
      MakeVisitSequence(Eigen::VectorXd::Constant(modes + 1, -std::log(modes + 1.0)),
                        ModeChain::Uniform(modes, options.leave_rate_per_s),
                        steps);
  sequence.static_state = std::min(1, modes);
  return sequence;
}

int SelectModes(const ModeOptions& options, MapProblem* problem, int threads) {
  int changed = 0;
  const std::unique_ptr<Selector> selector = MakeSelector(options.selector);
  const std::vector<std::vector<VisitRef>> by_group = VisitsByGroup(*problem);
  std::vector<ModeSequenceProblem> sequences(by_group.size());
  ForEachIndex(by_group.size(), threads, [&](std::size_t group) {
    if (by_group[group].empty()) return;
    sequences[group] = MakeGroupSequence(*problem, by_group[group], group, options);
  });
  for (std::size_t group = 0; group < by_group.size(); ++group) {
    const std::vector<VisitRef>& visits = by_group[group];
    if (visits.empty()) continue;
    const std::vector<int> states = selector->Select(sequences[group]).states;
    for (std::size_t t = 0; t < visits.size(); ++t) {
      int& assignment = AssignmentOf(problem, visits[t]);
      changed += assignment != states[t] - 1;
      assignment = states[t] - 1;  // State 0, absent, is kUnassigned.
    }
  }
  return changed;
}

int CreateModes(const ModeOptions& options, MapProblem* problem) {
  int created = 0;
  const std::vector<std::vector<VisitRef>> by_group = VisitsByGroup(*problem);
  for (std::size_t group = 0; group < by_group.size(); ++group) {
    const std::vector<BuildMode>& modes = problem->modes[group];
    const std::size_t known = modes.size();
    for (const VisitRef& ref : by_group[group]) {
      if (AssignmentOf(problem, ref) != kUnassigned) continue;
      const VisitCluster cluster = DensestCluster(
          VisitPositions(problem->runs[static_cast<std::size_t>(ref.run)], VisitOf(*problem, ref)),
          options.cluster_radius_m);
      if (cluster.count < options.min_sightings) continue;
      // An earlier visit may just have made a mode of this place.
      int mode = kUnassigned;
      for (std::size_t k = known; k < modes.size() && mode == kUnassigned; ++k) {
        const double distance = (modes[k].p_map_landmark - cluster.centre).norm();
        if (distance < 2.0 * options.cluster_radius_m) mode = static_cast<int>(k);
      }
      if (mode == kUnassigned) {
        mode = AddMode(static_cast<int>(group), {cluster.centre, kAbsent, false}, problem);
        ++created;
      }
      AssignmentOf(problem, ref) = mode;
    }
  }
  return created;
}

int MergeModes(const ModeOptions& options,
               const ModeDifferences& differences,
               MapProblem* problem) {
  const std::vector<ModeMerge> merges = FindMerges(options, differences, *problem);
  Merge(VisitsByGroup(*problem), merges, problem);
  problem->modes_merged += static_cast<int>(merges.size());
  return static_cast<int>(merges.size());
}

void DropUnusedModes(MapProblem* problem) {
  const std::vector<std::vector<VisitRef>> by_group = VisitsByGroup(*problem);
  for (std::size_t group = 0; group < problem->modes.size(); ++group) {
    for (int mode = static_cast<int>(problem->modes[group].size()) - 1; mode >= 0; --mode) {
      const bool used =
          std::any_of(by_group[group].begin(), by_group[group].end(), [&](const VisitRef& ref) {
            return AssignmentOf(problem, ref) == mode;
          });
      if (used || InPrior(problem->modes[group][static_cast<std::size_t>(mode)])) continue;
      EraseMode(by_group[group], group, mode, problem);
    }
  }
}

int DropFaintModes(const ModeOptions& options, MapProblem* problem) {
  const std::vector<std::vector<VisitRef>> by_group = VisitsByGroup(*problem);
  int dropped = 0;
  for (std::size_t group = 0; group < problem->modes.size(); ++group) {
    for (int mode = static_cast<int>(problem->modes[group].size()) - 1; mode >= 0; --mode) {
      std::size_t sightings = 0;
      for (const VisitRef& ref : by_group[group]) {
        if (AssignmentOf(problem, ref) == mode)
          sightings += VisitOf(*problem, ref).sightings.size();
      }
      if (sightings >= static_cast<std::size_t>(options.min_sightings) ||
          InPrior(problem->modes[group][static_cast<std::size_t>(mode)])) {
        continue;
      }
      Reassign(by_group[group], mode, kUnassigned, problem);
      EraseMode(by_group[group], group, mode, problem);
      ++dropped;
    }
  }
  return dropped;
}

namespace {

// RefineModes() with so many integrations of the odometry in each solve at most.
int Alternate(const MapperOptions& options,
              int max_integrations,
              MapProblem* problem,
              const GoOn& go_on) {
  std::set<std::vector<int>> seen;
  std::vector<int> solved;
  MergeMemory memory(*problem);
  for (int iteration = 1; iteration <= options.max_outer_iterations; ++iteration) {
    if (go_on && !go_on(*problem)) return iteration - 1;
    Select(options, problem);
    CreateModes(options.modes, problem);
    DropUnusedModes(problem);
    memory.MergeAgain(problem);
    const std::vector<int> state = DiscreteState(*problem);
    if (state == solved) return iteration;
    // A state that comes again closes a cycle.
    const bool recurs = !seen.insert(state).second;
    GraphSolver solver;
    const Graph graph = SolveContinuous(options, problem, &solver, max_integrations);
    solved = state;
    if (HasSeveralModes(*problem)) {
      const std::vector<ModeMerge> merges =
          FindMerges(options.modes, ModeDifferences(graph, &solver), *problem);
      problem->modes_merged += static_cast<int>(merges.size());
      memory.Merge(merges, problem);
      if (!merges.empty()) solved.clear();
    }
    if (recurs) {
      if (solved.empty()) SolveContinuous(options, problem, &solver, max_integrations);
      return iteration;
    }
  }
  return options.max_outer_iterations;
}

}  // namespace

int RefineModes(const MapperOptions& options, MapProblem* problem, const GoOn& go_on) {
  return Alternate(options, kMaxIntegrations, problem, go_on);
}

void SettleModes(const MapperOptions& options, MapProblem* problem, const GoOn& go_on) {
  constexpr int kAlternations = 2;
  constexpr int kIterations = 5;
  MapperOptions coarse = options;
  coarse.max_outer_iterations = std::min(kAlternations, options.max_outer_iterations);
  coarse.max_solver_iterations = std::min(kIterations, options.max_solver_iterations);
  Alternate(coarse, 1, problem, go_on);
}

}  // namespace shiftmap
