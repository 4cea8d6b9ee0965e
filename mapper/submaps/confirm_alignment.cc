// SPDX-License-Identifier: Apache-2.0
#include "mapper/submaps/confirm_alignment.h"

#include <algorithm>
#include <set>
#include <utility>

#include "mapper/submaps/variance_factor.h"

namespace shiftmap {
namespace {

// The joint covariance of the map so far, which is solved for that if its runs have only been
// placed.
std::optional<JointPoints> MapPoints(const MapperOptions& options,
                                     const std::optional<MapContent>& prior,
                                     const MapProblem& problem,
                                     double submap_factor) {
  JointPoints map;
  MapProblem solved = problem;
  if (problem.runs.empty()) {
    map.covariance = submap_factor * prior.value().covariance.Dense();
  } else {
    if (problem.runs.size() > 1 || prior) SolveContinuous(options, &solved);
    std::optional<Eigen::MatrixXd> covariance = SubmapCovariance(options, &solved);
    if (!covariance) return std::nullopt;
    const double factor = prior ? submap_factor : VarianceFactor(options, solved);
    map.covariance = factor * *covariance;
  }
  for (std::size_t group = 0; group < solved.modes.size(); ++group) {
    for (const BuildMode& mode : solved.modes[group]) {
      map.points.push_back({static_cast<int>(group), mode.p_map_landmark, Eigen::Matrix2d::Zero()});
    }
  }
  return map;
}

}  // namespace

bool NeedsConfirmation(const ConfirmationOptions& options,
                       const std::vector<AlignmentPoint>& reference,
                       const Submap& submap,
                       const Alignment& consensus) {
  std::set<int> in_reference;
  for (const AlignmentPoint& point : reference) in_reference.insert(point.group);
  std::set<int> common;
  for (const AlignmentPoint& point : submap.points) {
    if (in_reference.count(point.group) > 0) common.insert(point.group);
  }
  const auto agreeing = static_cast<double>(consensus.signatures.size());
  return agreeing < options.min_signatures ||
         agreeing <= options.min_share * static_cast<double>(common.size());
}

std::optional<Explanations> ExplainSubmap(const MapperOptions& options,
                                          const std::optional<MapContent>& prior,
                                          const MapProblem& problem,
                                          double area_m2,
                                          const Submap& submap) {
  if (FlatModes(problem).count > options.confirmation.max_modes) return std::nullopt;
  const double factor = VarianceFactor(options, submap.problem);
  const std::optional<JointPoints> map = MapPoints(options, prior, problem, factor);
  if (!map) return std::nullopt;
  return Explain(*map,
                 {submap.points, factor * submap.covariance},
                 area_m2,
                 options.confirmation.prior,
                 options.confirmation.limits);
}

const Explanation* Decided(const ConfirmationOptions& options, const Explanations& explanations) {
  const Explanation& best = explanations.frames.front();
  const bool decided = !best.nothing_stayed() && best.probability >= options.min_probability;
  return decided ? &best : nullptr;
}

}  // namespace shiftmap
