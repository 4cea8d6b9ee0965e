// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/displaced_modes.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "mapper/alignment/displaced_landmarks.h"
#include "mapper/alignment/explain_displacements.h"
#include "mapper/covariance/gauge.h"
#include "mapper/covariance/mode_covariance.h"
#include "mapper/registration/deformed_fit.h"
#include "mapper/rows.h"

namespace shiftmap {
namespace {

// Landmarks that are decided on together: time grows with the cube. Others than those around it
// hardly tell whether a landmark stands where it stood.
constexpr int kMaxTogether = 150;

constexpr int kMaxRounds = 3;

// What a run says by itself is read off the pull of what deforms it, where both are about at rest.
constexpr int kDeformationSteps = 10;
constexpr double kDeformationTolerance = 1e-3;  // Of the cost, for a step.

// Per mode how many of the prior's modes, those that have a number, are before it.
IndexedVector<ModeIndex, int> PriorNumbers(const BuildState& map) {
  IndexedVector<ModeIndex, int> numbers;
  int next = 0;
  for (const GroupModes& group : map.modes) {
    for (const BuildMode& mode : group) numbers.push_back(mode.number != kAbsent ? next++ : next);
  }
  return numbers;
}

// A landmark of the prior map that a run has met.
struct MetLandmark {
  ModeIndex flat;  // Of the run map.
  int prior_mode = 0;
  const ModeMatch* match = nullptr;
};

// Decides on landmarks together. Positions and covariance as in Decide().
std::vector<Displacement> DisplacementsOf(
    const MapperOptions& options,
    const JointCovariance& prior_covariance,
    const std::vector<MetLandmark>& candidates,
    const IndexedVector<ModeIndex, Eigen::Vector2d>& positions,
    const Eigen::MatrixXd& run_cov) {
  const Eigen::Index size = RowOf(candidates.size());
  Eigen::VectorXd difference(size);
  DifferenceCovariance cov{Eigen::MatrixXd(size, size), Eigen::MatrixXd(size, size), {}};
  std::vector<Eigen::Vector2d> before;
  for (std::size_t a = 0; a < candidates.size(); ++a) {
    const MetLandmark& of_a = candidates[a];
    before.push_back(of_a.match->known.p_map_landmark);
    difference.segment<2>(RowOf(a)) = positions[of_a.flat] - before.back();
    for (std::size_t b = 0; b < candidates.size(); ++b) {
      const MetLandmark& of_b = candidates[b];
      cov.run.block<2, 2>(RowOf(a), RowOf(b)) =
          run_cov.block<2, 2>(RowOf(of_a.flat), RowOf(of_b.flat));
      cov.map.block<2, 2>(RowOf(a), RowOf(b)) =
          prior_covariance.Block(of_a.prior_mode, of_b.prior_mode);
    }
  }
  cov.map.diagonal().array() += std::pow(options.displacement.position_floor_m, 2);
  cov.common = FreeGauge(before, options.sd_range_scale, Eigen::MatrixXd::Zero(size, size));
  return FindDisplaced(before, difference, cov, options.displacement);
}

// Decides on the landmarks that meet the prior, where they are many on those of one neighbourhood
// after the other.
// @param positions  Of the run map's modes as the run by itself has them. [m]
// @param run_cov    Of these, relative to them as a whole. [m²]
DisplacedModes Decide(const MapperOptions& options,
                      const JointCovariance& prior_covariance,
                      const BuildState& map,
                      const ModeMatches& matches,
                      const IndexedVector<ModeIndex, Eigen::Vector2d>& positions,
                      const Eigen::MatrixXd& run_cov) {
  DisplacedModes decided{ModeFlags(matches.size()), {}};
  const IndexedVector<ModeIndex, int> numbers = PriorNumbers(map);
  const FlatModes flat(map);
  IndexedVector<ModeIndex, MetLandmark> met;
  IndexedVector<ModeIndex, Eigen::Vector2d> places;
  for (const ModeIndex i : matches.indices()) {
    const ModeMatch& match = matches[i];
    if (!match.is_prior) continue;
    if (std::sqrt(match.nearest.squared_m2) >
        options.displacement.sure_sds * options.displacement.sd_displacement_m.back()) {
      decided.displaced[i] = true;
      continue;
    }
    met.push_back({i, numbers[flat.Index(match.group, *match.nearest.mode)], &match});
    places.push_back(match.known.p_map_landmark);
  }
  for (std::vector<ModeIndex> tile : TileModes(places, kMaxTogether)) {
    std::sort(tile.begin(), tile.end());
    std::vector<MetLandmark> candidates;
    for (const ModeIndex i : tile) candidates.push_back(met[i]);
    const std::vector<Displacement> displacements =
        DisplacementsOf(options, prior_covariance, candidates, positions, run_cov);
    IndexedVector<LandmarkIndex, GroupIndex> groups;
    for (const MetLandmark& candidate : candidates) {
      decided.displaced[candidate.flat] =
          displacements.front().clusters[groups.end_index()] != kNotDisplaced;
      groups.push_back(candidate.match->group);
    }
    // Where the run lies alike in all that is likely, a landmark in doubt does not matter to it.
    const Explanations precise =
        ExplainDisplacements(groups, displacements, options.displacement.position_floor_m);
    if (precise.best().probability >= options.confirmation.min_probability_of_most) continue;
    decided.explanations.push_back(
        ExplainDisplacements(groups, displacements, options.confirmation.limits.same_frame_m));
  }
  return decided;
}

// Modes of the run map that still are modes of the prior.
KnownModes Undisplaced(const ModeMatches& matches, const ModeFlags& displaced) {
  KnownModes known(matches.size());
  for (const ModeIndex i : matches.indices()) {
    if (matches[i].is_prior && !displaced[i]) known[i] = matches[i].nearest.mode;
  }
  return known;
}

// How far a run map would be deformed by what holds it, where most: the largest shift of a mode
//
//   P_·M (P'_MM + R)⁻¹ (z_M - p_M),   P' = P with gauge and scale left free. [m]
double Deformation(const MapperOptions& options,
                   const std::vector<GraphPrior>& held,
                   const RunMap& run_map) {
  if (held.size() < 2) return 0.0;
  const IndexedVector<ModeIndex, Eigen::Vector2d> positions = ModePositions(run_map.build);
  std::vector<ModeIndex> modes;
  Eigen::VectorXd difference(RowOf(held.size()));
  Eigen::VectorXd variance(difference.size());
  for (std::size_t k = 0; k < held.size(); ++k) {
    const ModeIndex mode = held[k].modes.front();
    difference.segment<2>(RowOf(k)) = held[k].mean - positions[mode];
    variance.segment<2>(RowOf(k)) = held[k].information.diagonal().cwiseInverse();
    modes.push_back(mode);
  }
  const std::vector<Eigen::Index> rows = RowsOf(modes);
  Eigen::MatrixXd K = FreeGauge(positions, options.sd_range_scale, run_map.covariance)(rows, rows);
  K.diagonal() += variance;
  const Eigen::VectorXd shift = run_map.covariance(Eigen::all, rows) * K.llt().solve(difference);
  double most = 0.0;
  for (const ModeIndex i : positions.indices()) {
    most = std::max(most, shift.segment<2>(2 * i).norm());
  }
  return most;
}

// Where a run by itself has its modes, seen from where it is deformed: there its own cost pulls as
// much as what deforms it, and to the other side. The distortions are fixed while it is deformed.
// [m]
IndexedVector<ModeIndex, Eigen::Vector2d> Undeformed(const std::vector<GraphPrior>& held,
                                                     const RunMap& run_map) {
  IndexedVector<ModeIndex, Eigen::Vector2d> positions = ModePositions(run_map.build);
  Eigen::VectorXd pull = Eigen::VectorXd::Zero(run_map.covariance.rows());
  for (const GraphPrior& of_mode : held) {
    const ModeIndex mode = of_mode.modes.front();
    pull.segment<2>(2 * mode) = of_mode.information * (positions[mode] - of_mode.mean);
  }
  Eigen::VectorXd shift = run_map.covariance * pull;
  const Eigen::MatrixXd& root = run_map.build.distortion_root;
  if (root.cols() > 0) shift -= ReferToPositions(positions, root * root.transpose()) * pull;
  for (const ModeIndex i : positions.indices()) positions[i] += shift.segment<2>(2 * i);
  return positions;
}

// Where a run map that is aligned has those of its modes that agree with the map.
ModePlaces Places(const Alignment& alignment, const BuildState& run_map) {
  ModePlaces places;
  for (const GroupIndex group : run_map.modes.indices()) {
    for (const BuildMode& mode : run_map.modes[group]) {
      places.emplace_back();
      if (alignment.Agrees(group)) places.back() = mode.p_map_landmark;
    }
  }
  return places;
}

}  // namespace

DisplacedModes FindDisplacedModes(const MapperOptions& options,
                                  const JointCovariance& prior_covariance,
                                  const BuildState& map,
                                  const Alignment& alignment,
                                  RunMap* run_map) {
  DisplacedModes decided;
  KnownModes known;  // Of what the run map is to be deformed onto.
  if (!IsStiff(*run_map, options.deformation)) {
    known = FitDeformedRunMap(options, map, Places(alignment, run_map->build), run_map);
  } else {
    const ModeMatches matches = MatchNearest(run_map->build, map);
    decided = Decide(options,
                     prior_covariance,
                     map,
                     matches,
                     ModePositions(run_map->build),
                     run_map->covariance);
    known = Undisplaced(matches, decided.displaced);
    if (Deformation(options, HoldKnown(options, map, known, *run_map), *run_map) <
        options.deformation.max_linear_m) {
      return decided;
    }
  }
  MapperOptions deformation = options;
  deformation.solver.cost_tolerance =
      std::max(kDeformationTolerance, options.solver.cost_tolerance);
  for (int round = 0; round < kMaxRounds; ++round) {
    const std::vector<GraphPrior> held = HoldKnown(options, map, known, *run_map);
    Deform(deformation, held, kDeformationSteps, run_map);
    const ModeMatches matches = MatchNearest(run_map->build, map);
    if (std::optional<Eigen::MatrixXd> covariance = RunMapCovariance(options, &run_map->build)) {
      run_map->covariance = *std::move(covariance);
    }
    DisplacedModes again = Decide(
        options, prior_covariance, map, matches, Undeformed(held, *run_map), run_map->covariance);
    const bool settled = again.displaced == decided.displaced;
    decided = std::move(again);
    if (settled) break;
    known = Undisplaced(matches, decided.displaced);
  }
  return decided;
}

}  // namespace shiftmap
