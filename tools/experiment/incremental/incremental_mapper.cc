// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/incremental/incremental_mapper.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <ranges>
#include <set>
#include <utility>

#include "localizer/models/observation_model.h"
#include "mapper/graph/sensor_bias.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"
#include "tools/experiment/incremental/unassigned_sightings.h"

namespace shiftmap {
namespace {

bool Contains(const std::vector<int>& values, int value) {
  return std::find(values.begin(), values.end(), value) != values.end();
}

// Selectors for which a landmark rather stays where it was.
bool KnowsTheChain(SelectorKind kind) {
  return kind != SelectorKind::kNearestNeighbor && kind != SelectorKind::kMaxMixture;
}

// The modes of all observations of some groups: what alternates.
std::vector<int> ChoicesOf(const Window& window, const std::vector<int>& groups) {
  std::vector<int> choices;
  for (const WindowFrame& frame : window.frames) {
    for (const WindowObservation& observation : frame.observations) {
      if (Contains(groups, observation.group)) choices.push_back(observation.mode);
    }
  }
  return choices;
}

// Groups with something to select: two modes, and a sighting in the window that has one.
std::vector<int> Selectable(const Window& window, const std::vector<IncrementalGroup>& groups) {
  std::set<int> found;
  for (const WindowFrame& frame : window.frames) {
    for (const WindowObservation& observation : frame.observations) {
      const bool several = groups[static_cast<std::size_t>(observation.group)].modes.size() > 1;
      if (several && observation.mode != kNoMode) found.insert(observation.group);
    }
  }
  return {found.begin(), found.end()};
}

Status CheckPrior(const IncrementalPrior& prior) {
  const auto rows = static_cast<Eigen::Index>(2 * prior.group.size());
  if (prior.mean.size() != rows || prior.cov.rows() != rows || prior.cov.cols() != rows) {
    return InvalidArgument("prior of {} modes: mean {}, covariance {} x {}",
                           prior.group.size(),
                           prior.mean.size(),
                           prior.cov.rows(),
                           prior.cov.cols());
  }
  std::vector<int> modes(static_cast<std::size_t>(std::max(0, prior.groups)));
  for (const int group : prior.group) {
    if (group < 0 || group >= prior.groups) {
      return InvalidArgument("prior: a mode of group {}, expected below {}", group, prior.groups);
    }
    ++modes[static_cast<std::size_t>(group)];
  }
  if (prior.choice_before.empty()) return OkStatus();
  if (prior.choice_before.size() != modes.size()) {
    return InvalidArgument(
        "prior of {} groups: {} choices", prior.groups, prior.choice_before.size());
  }
  for (std::size_t g = 0; g < modes.size(); ++g) {
    const int choice = prior.choice_before[g];
    if (choice != kNoMode && (choice < 0 || choice >= modes[g])) {
      return InvalidArgument("prior: choice {} of {} modes of group {}", choice, modes[g], g);
    }
  }
  return OkStatus();
}

}  // namespace

StatusOr<IncrementalMapper> IncrementalMapper::Create(const IncrementalOptions& options,
                                                      const IncrementalPrior& prior,
                                                      const PoseWithCovariance& start) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  SHIFTMAP_RETURN_IF_ERROR(CheckPrior(prior));
  const Eigen::LLT<Eigen::MatrixXd> factor(prior.cov);
  if (factor.info() != Eigen::Success) {
    return InvalidArgument("prior of {} modes: covariance is not positive definite",
                           prior.group.size());
  }
  IncrementalMapper mapper(options, start);
  const Eigen::MatrixXd unit = Eigen::MatrixXd::Identity(prior.cov.rows(), prior.cov.cols());
  mapper.AddPrior(prior, factor.matrixL().solve(unit));
  return mapper;
}

IncrementalMapper::IncrementalMapper(const IncrementalOptions& options,
                                     const PoseWithCovariance& start)
    : options_(options),
      selector_(MakeSelector(options.selector)),
      smoother_(options.smoother, start) {}

void IncrementalMapper::AddPrior(const IncrementalPrior& prior,
                                 const Eigen::MatrixXd& sqrt_information) {
  groups_.resize(static_cast<std::size_t>(prior.groups));
  std::vector<ModeIndex> known;
  for (std::size_t i = 0; i < prior.group.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(2 * i);
    const int mode = smoother_.AddMode(prior.mean.segment<2>(at), prior.cov.block<2, 2>(at, at));
    known.emplace_back(mode);
    IncrementalGroup& group = groups_[static_cast<std::size_t>(prior.group[i])];
    group.modes.push_back(mode);
    ++group.known;
  }
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    const bool one = groups_[g].known == 1;
    groups_[g].choice_before =
        !prior.choice_before.empty() ? prior.choice_before[g] : (one ? 0 : kNoMode);
  }
  smoother_.SetPrior({std::move(known), prior.mean, sqrt_information});
}

Status IncrementalMapper::Undetermined() const {
  return InvalidArgument("frame {} of the run: pose and modes are not determined",
                         retired_poses_.size() + window().frames.size() - 1);
}

void IncrementalMapper::Predict(const IncrementalFrame& frame) {
  if (stamps_.empty()) {
    smoother_.AddFrame();
  } else {
    SHIFTMAP_CHECK(frame.stamp >= stamps_.back(),
                   "frame {} s before the last",
                   ToSeconds(stamps_.back() - frame.stamp));
    smoother_.AddFrame(frame.motion);
  }
  stamps_.push_back(frame.stamp);
}

// The choice of the newest observation of a group that has one.
int IncrementalMapper::LatestMode(int group_index) const {
  for (const WindowFrame& frame : std::views::reverse(window().frames)) {
    for (const WindowObservation& seen : frame.observations) {
      if (seen.group == group_index && seen.mode != kNoMode) return seen.mode;
    }
  }
  const IncrementalGroup& group = groups_[static_cast<std::size_t>(group_index)];
  if (group.choice_before == kNoMode) return kNoMode;
  return group.modes[static_cast<std::size_t>(group.choice_before)];
}

int IncrementalMapper::Associate(const GroupObservation& seen, const Eigen::Matrix2d& cov_z) const {
  const std::vector<int>& modes = groups_[static_cast<std::size_t>(seen.group)].modes;
  if (modes.empty()) return kNoMode;
  if (options_.selector.kind == SelectorKind::kNoHypotheses) return modes.front();
  const double gate = ChiSquareQuantile(options_.gate_probability, 2);
  const int latest = KnowsTheChain(options_.selector.kind) ? LatestMode(seen.group) : kNoMode;
  int best = kNoMode;
  double best_score = -std::numeric_limits<double>::infinity();
  for (const int mode : modes) {
    const Innovation innovation =
        LinearizeBiased(seen.observation,
                        T_map_vehicle(),
                        window().modes[static_cast<std::size_t>(mode)].p_map_landmark,
                        window().calibration.tail<3>(),
                        options_.mean_squared_bearing_rad2);
    Eigen::Matrix<double, 2, 5> H;
    H << innovation.H_pose, innovation.H_landmark;
    const Eigen::Matrix2d S =
        Symmetrized(Eigen::Matrix2d(H * smoother_.PoseModeCovariance(mode) * H.transpose())) +
        cov_z;
    if (SquaredMahalanobis(innovation.nu, S) >= gate) continue;
    double score = LogGaussian(innovation.nu, S);
    if (latest != kNoMode && mode != latest) score += std::log(options_.change_probability);
    if (score <= best_score) continue;
    best_score = score;
    best = mode;
  }
  return best;
}

// Of the place where the newest pose sees a landmark, p = t + R (q + δq + ξ_xy + ξ_yaw × q).
Eigen::Matrix2d IncrementalMapper::SightingCovariance(const Observation& seen,
                                                      const Eigen::Matrix2d& cov_z) const {
  const Eigen::Vector2d q = seen.PositionInVehicle();
  const Eigen::Matrix2d R = T_map_vehicle().Rotation();
  Eigen::Matrix<double, 2, 3> J;
  J << R, R * Eigen::Vector2d(-q.y(), q.x());
  const Eigen::Matrix2d cov_q = PositionNoiseInVehicle(seen, cov_z);
  return Symmetrized(
      Eigen::Matrix2d(J * smoother_.PoseCovariance() * J.transpose() + R * cov_q * R.transpose()));
}

// Makes a mode of a group where enough of its sightings without one agree with the newest of them.
// Returns how many.
int IncrementalMapper::TryCreateMode(int group) {
  const std::vector<UnassignedSighting> sightings =
      AgreeingSightings(window(), group, ChiSquareQuantile(options_.gate_probability, 2));
  const bool at_once = options_.selector.kind == SelectorKind::kNoHypotheses;
  if (std::ssize(sightings) < (at_once ? 1 : options_.min_sightings)) return 0;
  const UnassignedSighting& best = SharpestSighting(sightings);
  const int mode = smoother_.AddMode(best.p_map_landmark, best.cov);
  groups_[static_cast<std::size_t>(group)].modes.push_back(mode);
  for (const UnassignedSighting& seen : sightings)
    smoother_.Switch(seen.frame, seen.observation, mode);
  return 1;
}

// Returns whether a choice changed.
bool IncrementalMapper::SelectModes(int group_index) {
  const IncrementalGroup& group = groups_[static_cast<std::size_t>(group_index)];
  const ModeWindow chain = MakeModeWindow(window(), group_index, group, options_);
  const std::vector<int> states = selector_->Select(chain.problem).states;
  bool changed = false;
  for (std::size_t t = 0; t < states.size(); ++t) {
    const SightingRef& at = chain.sightings[t];
    if (at.frame < 0) continue;
    const int mode = group.modes[static_cast<std::size_t>(states[t])];
    const WindowObservation& seen = window()
                                        .frames[static_cast<std::size_t>(at.frame)]
                                        .observations[static_cast<std::size_t>(at.observation)];
    if (seen.mode == mode) continue;
    smoother_.Switch(at.frame, at.observation, mode);
    changed = true;
  }
  return changed;
}

StatusOr<IncrementalStep> IncrementalMapper::Alternate(const std::vector<int>& groups) {
  const bool at_linearization = options_.selector.kind == SelectorKind::kMaxMixture;
  const int iterations = at_linearization ? 1 : options_.smoother.max_iterations;
  IncrementalStep step;
  std::set<std::vector<int>> seen = {ChoicesOf(window(), groups)};
  bool cycle = false;
  while (step.alternations < options_.max_alternations && !cycle) {
    if (!smoother_.Solve(iterations)) return Undetermined();
    ++step.alternations;
    bool changed = false;
    for (const int group : groups) changed = SelectModes(group) || changed;
    if (!changed) {
      if (at_linearization && !smoother_.Solve()) return Undetermined();
      return step;
    }
    cycle = !seen.insert(ChoicesOf(window(), groups)).second;
  }
  step.fully_optimized = true;
  if (!smoother_.SolveFully()) return Undetermined();
  return step;
}

// Returns how many modes went into another of the group.
int IncrementalMapper::MergeModes(int group_index) {
  IncrementalGroup& group = groups_[static_cast<std::size_t>(group_index)];
  const double bound = ChiSquareQuantile(options_.merge_probability, 2);
  const double floor = options_.position_floor_m * options_.position_floor_m;
  int merged = 0;
  for (int j = static_cast<int>(group.modes.size()) - 1; j >= std::max(1, group.known); --j) {
    for (int i = 0; i < j; ++i) {
      const int from = group.modes[static_cast<std::size_t>(j)];
      const int to = group.modes[static_cast<std::size_t>(i)];
      const Eigen::Matrix4d cov = smoother_.ModePairCovariance(from, to);
      const Eigen::Matrix2d cross = cov.topRightCorner<2, 2>();
      const Eigen::Matrix2d cov_difference =
          cov.topLeftCorner<2, 2>() + cov.bottomRightCorner<2, 2>() - cross - cross.transpose() +
          2.0 * floor * Eigen::Matrix2d::Identity();
      const Eigen::Vector2d difference =
          window().modes[static_cast<std::size_t>(from)].p_map_landmark -
          window().modes[static_cast<std::size_t>(to)].p_map_landmark;
      if (SquaredMahalanobis(difference, cov_difference) >= bound) continue;
      smoother_.MergeModes(from, to);
      std::replace(choices_.begin(), choices_.end(), from, to);
      group.modes.erase(group.modes.begin() + j);
      if (group.choice_before == j) group.choice_before = i;
      if (group.choice_before > j) --group.choice_before;
      ++merged;
      break;
    }
  }
  return merged;
}

// Lets go of what is older than the window.
void IncrementalMapper::Retire() {
  if (!std::isfinite(options_.window_s)) return;
  const Stamp begin = stamps_.back() - FromSeconds(options_.window_s);
  const auto first = std::lower_bound(stamps_.begin(), stamps_.end(), begin);
  const std::vector<WindowFrame> gone =
      smoother_.DropBefore(static_cast<int>(first - stamps_.begin()));
  stamps_.erase(stamps_.begin(), stamps_.begin() + std::ssize(gone));
  for (const WindowFrame& frame : gone) {
    retired_poses_.push_back(frame.T_map_vehicle);
    for (const WindowObservation& seen : frame.observations) {
      const int mode = seen.mode;
      choices_[static_cast<std::size_t>(seen.number)] = mode;
      if (mode == kNoMode) continue;
      IncrementalGroup& group = groups_[static_cast<std::size_t>(seen.group)];
      group.choice_before = static_cast<int>(
          std::find(group.modes.begin(), group.modes.end(), mode) - group.modes.begin());
    }
  }
}

StatusOr<IncrementalStep> IncrementalMapper::AddFrame(const IncrementalFrame& frame) {
  Predict(frame);
  if (!smoother_.Solve(1)) return Undetermined();
  int created = 0;
  std::vector<int> groups;
  for (const GroupObservation& seen : frame.observations) {
    SHIFTMAP_CHECK(seen.group >= 0 && seen.group < std::ssize(groups_),
                   "group {} of {}",
                   seen.group,
                   groups_.size());
    const Eigen::Matrix2d cov_z = ObservationNoise(seen.observation, options_.sensor);
    const int mode = Associate(seen, cov_z);
    GraphObservation factor;
    factor.observation = seen.observation;
    factor.cov_z = cov_z;
    factor.mean_squared_bearing = options_.mean_squared_bearing_rad2;
    smoother_.AddObservation({seen.group,
                              static_cast<int>(choices_.size()),
                              mode,
                              std::move(factor),
                              SightingCovariance(seen.observation, cov_z)});
    choices_.push_back(kNoMode);
    if (mode == kNoMode) created += TryCreateMode(seen.group);
  }
  for (const WindowObservation& seen : smoother_.newest().observations) {
    const bool several = groups_[static_cast<std::size_t>(seen.group)].modes.size() > 1;
    if (several && seen.mode != kNoMode) groups.push_back(seen.group);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(IncrementalStep step, Alternate(groups));
  step.modes_created = created;
  if (options_.merge_probability > 0.0) {
    for (const int group : groups) step.modes_merged += MergeModes(group);
    if (step.modes_merged > 0 && !smoother_.Solve()) return Undetermined();
  }
  Retire();
  return step;
}

Status IncrementalMapper::Finish() {
  SHIFTMAP_RETURN_IF_ERROR(Alternate(Selectable(window(), groups_)).status());
  return smoother_.SolveFully() ? OkStatus() : Undetermined();
}

std::vector<Se2> IncrementalMapper::Trajectory() const {
  std::vector<Se2> poses = retired_poses_;
  for (const WindowFrame& frame : window().frames) poses.push_back(frame.T_map_vehicle);
  return poses;
}

std::vector<Eigen::Vector2d> IncrementalMapper::Modes(int group) const {
  std::vector<Eigen::Vector2d> modes;
  for (const int mode : groups_[static_cast<std::size_t>(group)].modes) {
    modes.push_back(window().modes[static_cast<std::size_t>(mode)].p_map_landmark);
  }
  return modes;
}

std::vector<int> IncrementalMapper::Choices() const {
  std::vector<int> choices = choices_;
  for (const WindowFrame& frame : window().frames) {
    for (const WindowObservation& seen : frame.observations) {
      choices[static_cast<std::size_t>(seen.number)] = seen.mode;
    }
  }
  std::vector<int> number(window().modes.size(), kNoMode);
  for (const IncrementalGroup& group : groups_) {
    for (std::size_t k = 0; k < group.modes.size(); ++k) {
      number[static_cast<std::size_t>(group.modes[k])] = static_cast<int>(k);
    }
  }
  for (int& choice : choices) {
    if (choice != kNoMode) choice = number[static_cast<std::size_t>(choice)];
  }
  return choices;
}

}  // namespace shiftmap
