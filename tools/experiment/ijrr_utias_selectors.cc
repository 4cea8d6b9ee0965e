// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_utias_selectors.h"

#include <algorithm>
#include <memory>
#include <set>
#include <utility>

#include "localizer/models/detection_model.h"
#include "localizer/models/observation_model.h"
#include "mapper/graph/graph.h"
#include "mapper/selection/sequence_builders.h"
#include "mapstore/geometry/covariance.h"
#include "tools/experiment/ijrr_utias_filter.h"

namespace shiftmap {
namespace {

constexpr int kSolverIterations = 50;

// Of the first pose, which least squares over a map with some wrong places knows so well.
const Eigen::Vector3d kStartSd(0.5, 0.5, 0.1);

// A mode that is in view with less probability than this is not looked for, and what is seen of it
// is taken to have been in view as much.
constexpr double kMinFieldOfView = 0.05;

// Of what the graph could also estimate and is known here.
constexpr double kHeldSd = 1e-9;

/// The problem as it is being solved.
struct State {
  std::vector<Observation> observations;
  std::vector<MotionIncrement> motions;
  std::vector<Eigen::Matrix2d> cov_z;
  std::vector<Se2> poses;
  std::vector<std::vector<Eigen::Vector2d>> modes;  // Per group; the map's is the first.
  std::vector<int> sighting_modes;                  // Per sighting, in its group.
};

int GroupOf(const UtiasCase& data, int sighting) {
  const Sighting& seen = data.frames.sightings[static_cast<std::size_t>(sighting)];
  return data.frames.visits[static_cast<std::size_t>(seen.visit)].group;
}

// Goes through the run with the filter: poses, modes and the nearest mode of every sighting.
void Explore(const UtiasCase& data,
             const LandmarkPlaces& map,
             const Se2& T_map_start,
             const UtiasSelectorOptions& options,
             State* state) {
  const double gate = ChiSquareQuantile(options.gate_probability, 2);
  ModeFilter filter(T_map_start, kStartSd);
  std::vector<std::vector<int>> numbers;  // In the filter, per group.
  for (const Signature& signature : data.signatures) {
    numbers.push_back({filter.AddKnown(map.at(signature), options.prior_sd_m)});
  }
  for (std::size_t f = 0; f < data.frames.frames.size(); ++f) {
    if (f > 0) filter.Move(state->motions[f - 1]);
    const KeyFrame& frame = data.frames.frames[f];
    for (int s = frame.first_sighting; s < frame.first_sighting + frame.sighting_count; ++s) {
      const auto at = static_cast<std::size_t>(s);
      std::vector<int>& known = numbers[static_cast<std::size_t>(GroupOf(data, s))];
      int nearest = -1;
      double least = gate;
      for (std::size_t k = 0; k < known.size(); ++k) {
        const double squared =
            filter.SquaredDistance(state->observations[at], state->cov_z[at], known[k]);
        if (squared >= least) continue;
        least = squared;
        nearest = static_cast<int>(k);
      }
      if (nearest < 0) {
        nearest = static_cast<int>(known.size());
        known.push_back(filter.AddSeen(state->observations[at], state->cov_z[at]));
      } else {
        filter.Update(
            state->observations[at], state->cov_z[at], known[static_cast<std::size_t>(nearest)]);
      }
      state->sighting_modes[at] = nearest;
    }
    state->poses.push_back(filter.T_map_vehicle());
  }
  for (const std::vector<int>& group : numbers) {
    std::vector<Eigen::Vector2d>& modes = state->modes.emplace_back();
    for (const int number : group)
      modes.push_back(filter.modes()[static_cast<std::size_t>(number)]);
  }
}

// The chain of a group over the key frames at which it is seen or may be.
// @param sightings  Out: per step the sighting, or -1.
ModeSequenceProblem MakeSequence(const UtiasCase& data,
                                 const State& state,
                                 const SensorCalibration& sensor,
                                 int group,
                                 const UtiasSelectorOptions& options,
                                 std::vector<int>* sightings) {
  const std::vector<Eigen::Vector2d>& modes = state.modes[static_cast<std::size_t>(group)];
  std::vector<ObservationStep> steps;
  for (std::size_t f = 0; f < data.frames.frames.size(); ++f) {
    const KeyFrame& frame = data.frames.frames[f];
    Eigen::VectorXd in_view(std::ssize(modes));
    Observation expected;
    for (std::size_t k = 0; k < modes.size(); ++k) {
      expected.kind = Observation::Kind::kRangeBearing;
      expected.z.setZero();
      const Eigen::Vector2d h = -Linearize(expected, state.poses[f], modes[k]).nu;
      in_view[static_cast<Eigen::Index>(k)] =
          SectorFieldOfView(h, ObservationNoise(expected, sensor), sensor);
    }
    bool seen = false;
    for (int s = frame.first_sighting; s < frame.first_sighting + frame.sighting_count; ++s) {
      if (GroupOf(data, s) != group) continue;
      const auto at = static_cast<std::size_t>(s);
      Eigen::VectorXd log_density(std::ssize(modes));
      for (std::size_t k = 0; k < modes.size(); ++k) {
        log_density[static_cast<Eigen::Index>(k)] = LogGaussian(
            Linearize(state.observations[at], state.poses[f], modes[k]).nu, state.cov_z[at]);
      }
      steps.push_back(
          {options.detection_probability * in_view.cwiseMax(kMinFieldOfView), log_density});
      sightings->push_back(s);
      seen = true;
    }
    if (seen || in_view.maxCoeff() < kMinFieldOfView) continue;
    steps.push_back({options.detection_probability * in_view, std::nullopt});
    sightings->push_back(-1);
  }
  return MakeObservationSequence(
      Eigen::VectorXd::Constant(std::ssize(modes), 1.0 / static_cast<double>(modes.size())),
      options.change_probability,
      steps);
}

void SelectAll(const UtiasCase& data,
               const UtiasNoise& noise,
               const Selector& selector,
               const UtiasSelectorOptions& options,
               State* state) {
  SensorCalibration sensor = noise.sensor;
  sensor.max_range_m = options.max_range_m;
  sensor.max_bearing_rad = options.max_bearing_rad;
  for (std::size_t group = 0; group < state->modes.size(); ++group) {
    if (state->modes[group].size() < 2) continue;
    std::vector<int> sightings;
    const std::vector<int> states =
        selector
            .Select(
                MakeSequence(data, *state, sensor, static_cast<int>(group), options, &sightings))
            .states;
    for (std::size_t t = 0; t < states.size(); ++t) {
      if (sightings[t] < 0) continue;
      state->sighting_modes[static_cast<std::size_t>(sightings[t])] = states[t];
    }
  }
}

// The graph of the present selection: modes of the map, then those of others that are selected.
void Solve(const UtiasCase& data,
           const UtiasNoise& noise,
           const LandmarkPlaces& map,
           double prior_sd_m,
           int iterations,
           State* state) {
  Graph graph;
  graph.loss_scale = noise.loss_scale;
  GraphRun run;
  run.poses = state->poses;
  run.motions = state->motions;
  run.correction_prior_sd.setConstant(kHeldSd);
  run.sensor_bias_sd.setConstant(kHeldSd);
  graph.runs.push_back(std::move(run));

  std::vector<std::pair<std::size_t, std::size_t>> members;  // Group and mode, per graph mode.
  std::vector<std::vector<int>> index;
  for (std::size_t group = 0; group < state->modes.size(); ++group) {
    index.emplace_back(state->modes[group].size(), -1);
    index[group][0] = static_cast<int>(members.size());
    graph.prior.modes.push_back(static_cast<int>(members.size()));
    members.emplace_back(group, 0);
  }
  const auto known = static_cast<Eigen::Index>(2 * members.size());
  graph.prior.mean.resize(known);
  for (std::size_t group = 0; group < state->modes.size(); ++group) {
    graph.prior.mean.segment<2>(static_cast<Eigen::Index>(2 * group)) =
        map.at(data.signatures[group]);
  }
  graph.prior.sqrt_information = Eigen::MatrixXd::Identity(known, known) / prior_sd_m;
  for (std::size_t s = 0; s < state->observations.size(); ++s) {
    const auto group = static_cast<std::size_t>(GroupOf(data, static_cast<int>(s)));
    const auto mode = static_cast<std::size_t>(state->sighting_modes[s]);
    if (index[group][mode] < 0) {
      index[group][mode] = static_cast<int>(members.size());
      members.emplace_back(group, mode);
    }
    graph.observations.push_back({0,
                                  data.frames.sightings[s].frame,
                                  index[group][mode],
                                  state->observations[s],
                                  state->cov_z[s],
                                  0.0});
  }
  for (const auto& [group, mode] : members) graph.modes.push_back(state->modes[group][mode]);
  SolveGraph(iterations, &graph);
  state->poses = graph.runs.front().poses;
  for (std::size_t m = 0; m < members.size(); ++m) {
    state->modes[members[m].first][members[m].second] = graph.modes[m];
  }
}

}  // namespace

UtiasEstimate SolveWithSelector(const UtiasCase& data,
                                const UtiasNoise& noise,
                                const LandmarkPlaces& map,
                                const UtiasSelectorOptions& options) {
  State state;
  state.observations = UtiasObservations(data, noise);
  state.motions = UtiasMotions(data, noise);
  for (const Observation& observation : state.observations) {
    state.cov_z.push_back(ObservationNoise(observation, noise.sensor));
  }
  state.sighting_modes.assign(state.observations.size(), 0);
  Explore(data, map, StartPoses(data, noise, map).front(), options, &state);

  const std::unique_ptr<Selector> selector = MakeSelector(options.selector);
  const bool at_linearization = options.selector.kind == SelectorKind::kMaxMixture;
  const int alternations = at_linearization ? kSolverIterations : options.max_alternations;
  Solve(data, noise, map, options.prior_sd_m, kSolverIterations, &state);
  std::set<std::vector<int>> seen;
  for (int i = 0; i < alternations; ++i) {
    SelectAll(data, noise, *selector, options, &state);
    const bool recurs = !seen.insert(state.sighting_modes).second;
    const int iterations = at_linearization && !recurs ? 1 : kSolverIterations;
    Solve(data, noise, map, options.prior_sd_m, iterations, &state);
    if (recurs) break;
  }
  UtiasEstimate estimate;
  estimate.poses = state.poses;
  estimate.modes = state.modes;
  estimate.sighting_modes = state.sighting_modes;
  for (const auto& modes : state.modes) estimate.created += static_cast<int>(modes.size()) - 1;
  return estimate;
}

}  // namespace shiftmap
