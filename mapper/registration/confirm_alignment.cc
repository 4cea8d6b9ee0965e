// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/confirm_alignment.h"

#include <algorithm>
#include <set>
#include <utility>

#include "mapper/alignment/rigid_bodies.h"
#include "mapper/calibration/distortion_calibration.h"
#include "mapper/registration/mode_match.h"
#include "mapper/run_maps/variance_factor.h"

namespace shiftmap {
namespace {

// The modes that a map has of some groups.
IndexedVector<ModeIndex, ModeIndex> ModesOfGroups(const BuildState& map,
                                                  const std::set<GroupIndex>& groups) {
  const FlatModes flat(map);
  IndexedVector<ModeIndex, ModeIndex> modes;
  for (const GroupIndex group : groups) {
    for (const GroupModeIndex mode : map.modes[group].indices()) {
      modes.push_back(flat.Index(group, mode));
    }
  }
  return modes;
}

// Modes of the map so far with their joint covariance; it is solved for that, as its runs may have
// only been placed.
// @param modes  Those of `groups`.
std::optional<JointPoints> MapPoints(const MapperOptions& options,
                                     const std::optional<MapContent>& prior,
                                     const BuildState& build,
                                     const std::set<GroupIndex>& groups,
                                     const std::vector<ModeIndex>& modes) {
  JointPoints map;
  BuildState solved = build;
  if (build.runs.empty()) {
    std::vector<int> rows;
    for (const ModeIndex mode : modes) rows.push_back(mode.value());
    map.covariance = prior.value().covariance.Dense(rows);
  } else {
    SolveWithDistortions(options, &solved);
    std::optional<Eigen::MatrixXd> covariance = CovarianceOfModes(options, modes, &solved);
    if (!covariance) return std::nullopt;
    const double factor = prior ? 1.0 : VarianceFactor(options, solved);
    map.covariance = factor * *covariance;
  }
  map.points = PointsOfGroups(solved, groups);
  return map;
}

// Takes out all groups of a body but one of those that are there.
void KeepOne(const AlignmentEvidence& evidence,
             const MatchSet& body,
             std::set<GroupIndex>* groups) {
  bool is_first = true;
  for (const MatchIndex k : body.Members()) {
    const auto found = groups->find(evidence.GroupOf(k));
    if (found == groups->end()) continue;
    if (!std::exchange(is_first, false)) groups->erase(found);
  }
}

}  // namespace

ConsensusPlace::ConsensusPlace(const MapperOptions& options,
                               const AlignmentPoints& reference,
                               double area_m2,
                               const RunMap& run_map,
                               const std::optional<Alignment>& consensus)
    : options_(options),
      reference_(reference),
      area_m2_(area_m2),
      run_map_(run_map),
      consensus_(consensus),
      most_agree_(consensus && MostAgree()) {}

bool ConsensusPlace::MostAgree() const {
  const ConfirmationOptions& options = options_.confirmation;
  const JointPoints reference{reference_, {}};
  const JointPoints run_map{run_map_.points, {}};
  const AlignmentEvidence evidence(reference, run_map, area_m2_, options.prior);
  std::set<GroupIndex> common(evidence.groups().begin(), evidence.groups().end());
  std::set<GroupIndex> agreeing(consensus_->signatures.begin(), consensus_->signatures.end());
  if (evidence.matches().size() <= kMaxMatches) {
    const RigidBodies rigid(evidence);
    for (const MatchSet& body : rigid.clusters()) {
      KeepOne(evidence, body, &common);
      KeepOne(evidence, body, &agreeing);
    }
  }
  return std::ssize(agreeing) >= options.min_signatures &&
         static_cast<double>(agreeing.size()) >
             options.min_share * static_cast<double>(common.size());
}

bool ConsensusPlace::NeedsConfirmation() const {
  if (!most_agree_) return true;
  if (!IsStiff(run_map_, options_.deformation)) return false;
  AlignmentPoints others = run_map_.points;
  std::erase_if(others,
                [&](const AlignmentPoint& point) { return consensus_->Agrees(point.group); });
  return AlignByConsensus(reference_, others, area_m2_, options_.alignment).has_value();
}

bool ConsensusPlace::Is(const Alignment& other) const {
  if (!consensus_) return false;
  return std::all_of(
      run_map_.points.begin(), run_map_.points.end(), [&](const AlignmentPoint& point) {
        return (consensus_->T_reference_other * point.position -
                other.T_reference_other * point.position)
                   .norm() < options_.confirmation.limits.same_frame_m;
      });
}

bool ConsensusPlace::Decides(const Explanation& best) const {
  const ConfirmationOptions& options = options_.confirmation;
  if (best.nothing_stayed()) return false;
  const bool most = most_agree_ && Is(best.alignment);
  return best.probability >= (most ? options.min_probability_of_most : options.min_probability);
}

std::optional<Explanations> ExplainRunMap(const MapperOptions& options,
                                          const std::optional<MapContent>& prior,
                                          const BuildState& build,
                                          double area_m2,
                                          const RunMap& run_map) {
  std::set<GroupIndex> groups;
  for (const AlignmentPoint& point : run_map.points) groups.insert(point.group);
  const IndexedVector<ModeIndex, ModeIndex> modes = ModesOfGroups(build, groups);
  if (modes.empty() || std::ssize(modes) > options.confirmation.max_modes) return std::nullopt;
  const double factor = VarianceFactor(options, run_map.build);
  const std::optional<JointPoints> map = MapPoints(options, prior, build, groups, modes);
  if (!map) return std::nullopt;
  std::optional<Explanations> explanations = Explain(*map,
                                                     {run_map.points, factor * run_map.covariance},
                                                     area_m2,
                                                     options.confirmation.prior,
                                                     options.confirmation.limits);
  if (!explanations) return std::nullopt;
  for (Explanation& frame : explanations->frames) {
    for (Match& match : frame.stayed) match.reference = modes[match.reference];
  }
  return explanations;
}

}  // namespace shiftmap
