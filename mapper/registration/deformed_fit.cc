// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/deformed_fit.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

#include "mapper/covariance/gauge.h"
#include "mapper/rows.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// So many modes hold a run map while it is deformed: they are seen every few metres.
constexpr int kMaxHeld = 40;

// A run map's modes as what is known of them tells of the others.
class DeformedRunMap {
 public:
  DeformedRunMap(const MapperOptions& options, const RunMap& run_map, const BuildState& map)
      : options_(options.deformation),
        map_(map),
        noise_(2.0 * std::pow(options.modes.position_floor_m, 2)),
        gate_(ChiSquareQuantile(options.modes.merge_probability, 2)),
        group_(GroupsOfModes(run_map.build)),
        positions_(ModePositions(run_map.build)),
        covariance_(FreeGauge(positions_, options.sd_range_scale, run_map.covariance)) {}

  // Takes modes for known, and conditions `open` on them, for Match(). False if their
  // covariance is not positive definite.
  bool Hold(const KnownModes& known, std::vector<ModeIndex> open) {
    std::vector<ModeIndex> first;
    for (const ModeIndex i : known.indices()) {
      if (known[i]) first.push_back(i);
    }
    held_.clear();
    whitened_.resize(0);
    L_.resize(0, 0);
    inverse_L_.resize(0, 0);
    open_ = std::move(open);
    explained_.resize(0, RowOf(open_.size()));
    return Extend(known, first, Eigen::MatrixXd(0, RowOf(first.size())));
  }

  // Takes those of the open modes that are known now for known as well.
  bool HoldMore(const KnownModes& known) {
    std::vector<ModeIndex> added;
    std::vector<ModeIndex> left;
    std::vector<std::size_t> added_at;
    std::vector<std::size_t> left_at;
    for (std::size_t k = 0; k < open_.size(); ++k) {
      const bool is_known = known[open_[k]].has_value();
      (is_known ? added : left).push_back(open_[k]);
      (is_known ? added_at : left_at).push_back(k);
    }
    const Eigen::MatrixXd W = explained_(Eigen::all, RowsOf(added_at));
    explained_ = explained_(Eigen::all, RowsOf(left_at)).eval();
    open_ = std::move(left);
    return Extend(known, added, W);
  }

  // Modes that are neither known nor given up.
  const std::vector<ModeIndex>& open() const { return open_; }

  // Of the known modes, those that the others contradict. With K = P_MM + R and differences d, a
  // match differs from what the others say of it by [K⁻¹]_ii⁻¹ [K⁻¹ d]_i, of covariance [K⁻¹]_ii⁻¹.
  std::vector<ModeIndex> Contradicted() {
    Invert();
    const double gate = options_.variance_factor * ChiSquareQuantile(options_.contradiction, 2);
    std::vector<ModeIndex> contradicted;
    for (std::size_t k = 0; k < held_.size(); ++k) {
      const Eigen::Index below = whitened_.size() - RowOf(k);
      const auto of_match = inverse_L_.block(RowOf(k), RowOf(k), below, 2);
      const Eigen::Matrix2d information = of_match.transpose() * of_match;
      const Eigen::Vector2d at = of_match.transpose() * whitened_.tail(below);
      if (at.dot(information.llt().solve(at)) > gate) contradicted.push_back(held_[k]);
    }
    return contradicted;
  }

  // The mode of the map that an open mode is, or kUnassigned if that does not show.
  // @param place  Of the mode in open().
  OptionalMode Match(std::size_t place, double max_sd) const {
    const ModeIndex i = open_[place];
    const Eigen::Index row = RowOf(i);
    const Eigen::Vector2d expected = positions_[i] + shift_.segment<2>(RowOf(place));
    const auto explained = explained_.middleCols<2>(RowOf(place));
    const Eigen::Matrix2d cov =
        covariance_.block<2, 2>(row, row) - explained.transpose() * explained;
    if (0.5 * cov.trace() > max_sd * max_sd) return kUnassigned;
    const OptionalMode nearest = FindNearest(map_, group_[i], expected).mode;
    if (!nearest) return kUnassigned;
    const Eigen::Matrix2d S =
        options_.variance_factor * Symmetrized(cov) + noise_ * Eigen::Matrix2d::Identity();
    const bool agrees = SquaredMahalanobis(ModeAt(i, *nearest) - expected, S) <= gate_;
    return agrees ? nearest : kUnassigned;
  }

 private:
  // Takes more modes for known. With W = L⁻¹ P of the new ones and S the covariance of their
  // differences given the others, the new rows of L are [Wᵀ  L_S], S = L_S L_Sᵀ.
  bool Extend(const KnownModes& known,
              const std::vector<ModeIndex>& added,
              const Eigen::MatrixXd& W) {
    const std::vector<Eigen::Index> rows = RowsOf(added);
    const Eigen::Index before = whitened_.size();
    const Eigen::Index more = RowOf(added.size());
    Eigen::MatrixXd S = covariance_(rows, rows) - W.transpose() * W;
    S.diagonal().array() += noise_;
    const Eigen::LLT<Eigen::MatrixXd> llt(S);
    if (llt.info() != Eigen::Success) return false;

    Eigen::VectorXd differences(more);
    for (std::size_t k = 0; k < added.size(); ++k) {
      const ModeIndex i = added[k];
      differences.segment<2>(RowOf(k)) = ModeAt(i, *known[i]) - positions_[i];
    }
    differences -= W.transpose() * whitened_;
    whitened_.conservativeResize(before + more);
    whitened_.tail(more) = llt.matrixL().solve(differences);

    explained_.conservativeResize(before + more, Eigen::NoChange);
    if (!open_.empty()) {  // Eigen's solve refers to the first entry, also of a block without any.
      explained_.bottomRows(more) = llt.matrixL().solve(covariance_(rows, RowsOf(open_)) -
                                                        W.transpose() * explained_.topRows(before));
    }
    shift_ = explained_.transpose() * whitened_;

    L_.conservativeResize(before + more, before + more);
    L_.bottomLeftCorner(more, before) = W.transpose();
    L_.bottomRightCorner(more, more) = llt.matrixL();
    held_.insert(held_.end(), added.begin(), added.end());
    return true;
  }

  // Brings L⁻¹ up to L, some rows after the others:
  //
  //   | L      |⁻¹   |      L⁻¹             |
  //   | Wᵀ L_S |   = | -L_S⁻¹ Wᵀ L⁻¹  L_S⁻¹ |
  void Invert() {
    constexpr Eigen::Index kRows = 200;  // More take no advantage of the zeros.
    Eigen::Index done = inverse_L_.rows();
    inverse_L_.conservativeResize(L_.rows(), L_.rows());
    while (done < L_.rows()) {
      const Eigen::Index rows = std::min(kRows, L_.rows() - done);
      const auto L_S = L_.block(done, done, rows, rows).triangularView<Eigen::Lower>();
      inverse_L_.block(done, done, rows, rows) = L_S.solve(Eigen::MatrixXd::Identity(rows, rows));
      if (done > 0) {  // Eigen's product with a triangle of no size divides by zero.
        auto new_rows = inverse_L_.block(done, 0, rows, done);
        new_rows = -L_.block(done, 0, rows, done) *
                   inverse_L_.topLeftCorner(done, done).triangularView<Eigen::Lower>();
        L_S.solveInPlace(new_rows);
      }
      done += rows;
    }
  }

  const Eigen::Vector2d& ModeAt(ModeIndex i, GroupModeIndex mode) const {
    return map_.modes[group_[i]][mode].p_map_landmark;
  }

  const DeformationOptions& options_;
  const BuildState& map_;
  double noise_;  // Between a mode of the run map and the same of the map, per axis. [m²]
  double gate_;
  IndexedVector<ModeIndex, GroupIndex> group_;
  IndexedVector<ModeIndex, Eigen::Vector2d> positions_;
  Eigen::MatrixXd covariance_;

  // Of the known modes, in the order in which they became known; L Lᵀ = P + noise.
  std::vector<ModeIndex> held_;
  Eigen::MatrixXd L_;          // Its lower triangle.
  Eigen::MatrixXd inverse_L_;  // Of the first of them; its lower triangle.
  Eigen::VectorXd whitened_;   // L⁻¹ of the differences, map less run map.

  // Of the open ones. Columns: what the known modes explain of each coordinate, L⁻¹ P.
  std::vector<ModeIndex> open_;
  Eigen::MatrixXd explained_;
  Eigen::VectorXd shift_;
};

}  // namespace

KnownModes GrowMatches(const MapperOptions& options,
                       const RunMap& run_map,
                       const BuildState& map,
                       KnownModes known,
                       const ModeFlags& fixed) {
  DeformedRunMap deformed(options, run_map, map);
  ModeFlags settled = fixed;
  for (const ModeIndex i : known.indices()) {
    if (known[i]) settled[i] = true;
  }
  const auto hold = [&] {
    std::vector<ModeIndex> open;
    for (const ModeIndex i : known.indices()) {
      if (!known[i] && !settled[i]) open.push_back(i);
    }
    return deformed.Hold(known, std::move(open));
  };
  if (!hold()) return known;
  for (double max_sd = options.deformation.first_max_sd_m;
       max_sd <= options.deformation.last_max_sd_m && !deformed.open().empty();) {
    bool grew = false;
    for (std::size_t k = 0; k < deformed.open().size(); ++k) {
      OptionalMode& match = known[deformed.open()[k]];
      match = deformed.Match(k, max_sd);
      grew = grew || match;
    }
    max_sd = grew ? options.deformation.first_max_sd_m : 2.0 * max_sd;
    if (!grew) continue;
    if (!deformed.HoldMore(known)) return known;
    bool dropped = false;
    for (const ModeIndex i : deformed.Contradicted()) {
      dropped = dropped || !settled[i];
      if (!settled[i]) known[i] = kUnassigned;
      settled[i] = true;
    }
    if (dropped && !hold()) return known;
  }
  return known;
}

KnownModes FitDeformedRunMap(const MapperOptions& options,
                             const BuildState& map,
                             const ModePlaces& places,
                             RunMap* run_map) {
  constexpr int kMaxRounds = 4;
  const auto groups = GroupsOfModes(run_map->build);
  KnownModes known;
  for (const ModeIndex i : groups.indices()) {
    known.push_back(places[i] ? FindNearest(map, groups[i], *places[i]).mode : kUnassigned);
  }
  for (int round = 0; round < kMaxRounds; ++round) {
    DeformOntoMap(options, map, known, run_map);
    std::optional<Eigen::MatrixXd> covariance = RunMapCovariance(options, &run_map->build);
    if (!covariance) break;
    run_map->covariance = *std::move(covariance);
    KnownModes grown = GrowMatches(options, *run_map, map, known, ModeFlags(known.size()));
    if (grown == known) break;
    known = std::move(grown);
  }
  DeformOntoMap(options, map, known, run_map);
  return known;
}

std::vector<GraphPrior> HoldKnown(const MapperOptions& options,
                                  const BuildState& map,
                                  const KnownModes& known,
                                  const RunMap& run_map) {
  const auto groups = GroupsOfModes(run_map.build);
  const int step = CountKnown(known) / kMaxHeld + 1;
  int count = 0;
  std::vector<ModeIndex> held;
  std::vector<Eigen::Vector2d> places;
  for (const ModeIndex i : known.indices()) {
    if (!known[i] || count++ % step != 0) continue;
    held.push_back(i);
    places.push_back(map.modes[groups[i]][*known[i]].p_map_landmark);
  }
  return HoldModes(held, places, std::sqrt(2.0) * options.modes.position_floor_m);
}

void Deform(const MapperOptions& options,
            const std::vector<GraphPrior>& held,
            int steps,
            RunMap* run_map) {
  MapperOptions few = options;
  few.solver.max_iterations = std::min(steps, options.solver.max_iterations);
  run_map->build.priors = held;
  SolveContinuous(few, &run_map->build);
  run_map->build.priors.clear();
}

void DeformOntoMap(const MapperOptions& options,
                   const BuildState& map,
                   const KnownModes& known,
                   RunMap* run_map) {
  // The next solve goes on from where this one ends.
  constexpr int kSteps = 4;
  Deform(options, HoldKnown(options, map, known, *run_map), kSteps, run_map);
}

}  // namespace shiftmap
