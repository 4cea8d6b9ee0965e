// SPDX-License-Identifier: Apache-2.0
#include "mapper/submaps/confirm_alignment.h"

#include <algorithm>
#include <set>
#include <utility>

#include "mapper/alignment/rigid_bodies.h"
#include "mapper/submaps/variance_factor.h"

namespace shiftmap {
namespace {

// The modes that a map has of some groups, flat indices.
std::vector<int> ModesOfGroups(const MapProblem& map, const std::set<int>& groups) {
  const FlatModes flat(map);
  std::vector<int> modes;
  for (const int group : groups) {
    const auto count = static_cast<int>(map.modes[static_cast<std::size_t>(group)].size());
    for (int mode = 0; mode < count; ++mode) modes.push_back(flat.Index(group, mode));
  }
  return modes;
}

// Modes of the map so far with their joint covariance; it is solved for that if its runs have only
// been placed.
// @param modes  Flat indices, those of `groups`.
std::optional<JointPoints> MapPoints(const MapperOptions& options,
                                     const std::optional<MapContent>& prior,
                                     const MapProblem& problem,
                                     const std::set<int>& groups,
                                     const std::vector<int>& modes,
                                     double submap_factor) {
  JointPoints map;
  MapProblem solved = problem;
  if (problem.runs.empty()) {
    map.covariance = submap_factor * prior.value().covariance.Dense(modes);
  } else {
    if (problem.runs.size() > 1 || prior) SolveContinuous(options, &solved);
    std::optional<Eigen::MatrixXd> covariance = CovarianceOfModes(options, modes, &solved);
    if (!covariance) return std::nullopt;
    const double factor = prior ? submap_factor : VarianceFactor(options, solved);
    map.covariance = factor * *covariance;
  }
  for (const int group : groups) {
    for (const BuildMode& mode : solved.modes[static_cast<std::size_t>(group)]) {
      map.points.push_back({group, mode.p_map_landmark, Eigen::Matrix2d::Zero()});
    }
  }
  return map;
}

// Takes out all groups of a body but one of those that are there.
void KeepOne(const AlignmentEvidence& evidence, const MatchSet& body, std::set<int>* groups) {
  bool is_first = true;
  for (const int k : body.Members()) {
    const auto found = groups->find(evidence.GroupOf(k));
    if (found == groups->end()) continue;
    if (!std::exchange(is_first, false)) groups->erase(found);
  }
}

}  // namespace

bool FewAgree(const ConfirmationOptions& options,
              const std::vector<AlignmentPoint>& reference,
              double area_m2,
              const Submap& submap,
              const Alignment& consensus) {
  const JointPoints of_reference{reference, {}};
  const JointPoints of_submap{submap.points, {}};
  const AlignmentEvidence evidence(of_reference, of_submap, area_m2, options.prior);
  std::set<int> common(evidence.groups().begin(), evidence.groups().end());
  std::set<int> agreeing(consensus.signatures.begin(), consensus.signatures.end());
  if (evidence.matches().size() <= kMaxMatches) {
    const RigidBodies rigid(evidence, options.prior);
    for (const MatchSet& body : rigid.clusters()) {
      KeepOne(evidence, body, &common);
      KeepOne(evidence, body, &agreeing);
    }
  }
  return std::ssize(agreeing) < options.min_signatures ||
         static_cast<double>(agreeing.size()) <=
             options.min_share * static_cast<double>(common.size());
}

bool NeedsConfirmation(const MapperOptions& options,
                       const std::vector<AlignmentPoint>& reference,
                       double area_m2,
                       const Submap& submap,
                       const std::optional<Alignment>& consensus) {
  if (!consensus || FewAgree(options.confirmation, reference, area_m2, submap, *consensus))
    return true;
  if (!IsStiff(submap)) return false;
  std::vector<AlignmentPoint> others;
  for (const AlignmentPoint& point : submap.points) {
    const bool agrees =
        std::binary_search(consensus->signatures.begin(), consensus->signatures.end(), point.group);
    if (!agrees) others.push_back(point);
  }
  return AlignByConsensus(reference, others, area_m2, options.alignment).has_value();
}

std::optional<Explanations> ExplainSubmap(const MapperOptions& options,
                                          const std::optional<MapContent>& prior,
                                          const MapProblem& problem,
                                          double area_m2,
                                          const Submap& submap) {
  std::set<int> groups;
  for (const AlignmentPoint& point : submap.points) groups.insert(point.group);
  const std::vector<int> modes = ModesOfGroups(problem, groups);
  if (modes.empty() || std::ssize(modes) > options.confirmation.max_modes) return std::nullopt;
  const double factor = VarianceFactor(options, submap.problem);
  const std::optional<JointPoints> map = MapPoints(options, prior, problem, groups, modes, factor);
  if (!map) return std::nullopt;
  std::optional<Explanations> explanations = Explain(*map,
                                                     {submap.points, factor * submap.covariance},
                                                     area_m2,
                                                     options.confirmation.prior,
                                                     options.confirmation.limits);
  if (!explanations) return std::nullopt;
  for (Explanation& frame : explanations->frames) {
    for (Match& match : frame.stayed) {
      match.reference = modes[static_cast<std::size_t>(match.reference)];
    }
  }
  return explanations;
}

bool IsSamePlace(const ConfirmationOptions& options,
                 const Submap& submap,
                 const Alignment& one,
                 const Alignment& other) {
  return std::all_of(submap.points.begin(), submap.points.end(), [&](const AlignmentPoint& point) {
    return (one.T_reference_other * point.position - other.T_reference_other * point.position)
               .norm() < options.limits.same_frame_m;
  });
}

bool IsDecided(const ConfirmationOptions& options,
               const std::vector<AlignmentPoint>& reference,
               double area_m2,
               const Submap& submap,
               const std::optional<Alignment>& consensus,
               const Explanation& best) {
  if (best.nothing_stayed()) return false;
  const bool most = consensus && !FewAgree(options, reference, area_m2, submap, *consensus) &&
                    IsSamePlace(options, submap, best.alignment, *consensus);
  return best.probability >= (most ? options.min_probability_of_most : options.min_probability);
}

}  // namespace shiftmap
