// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/run_map_alignment.h"

#include <algorithm>
#include <utility>

#include "mapper/covariance/gauge.h"
#include "mapper/covariance/mode_covariance.h"

namespace shiftmap {
namespace {

// A run map whose worst mode is not known to this, relative to the others, is deformed. [m]
constexpr double kDeformedSd = 0.5;

// Modes of a part: a vehicle sees as many within a minute or two.
constexpr int kPartModes = 24;

// The modes of a part, with covariances relative to them as a whole.
AlignmentPoints PointsOf(const RunMap& run_map, const std::vector<ModeIndex>& part) {
  AlignmentPoints points;
  std::vector<Eigen::Vector2d> positions;
  std::vector<Eigen::Index> rows;
  for (const ModeIndex mode : part) {
    points.push_back(run_map.points[mode]);
    positions.push_back(points.back().position);
    for (const int axis : {0, 1}) rows.push_back(2 * mode + axis);
  }
  const Eigen::MatrixXd cov = ReferToPositions(positions, run_map.covariance(rows, rows));
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(2 * i);
    points[ModeIndex(i)].cov = cov.block<2, 2>(at, at);
  }
  return points;
}

// Of a part's modes, those whose group agrees go where the alignment has them.
void AddPlaces(const Alignment& alignment,
               const RunMap& run_map,
               const std::vector<ModeIndex>& part,
               IndexedVector<ModeIndex, std::optional<Eigen::Vector2d>>* places) {
  for (const ModeIndex mode : part) {
    const AlignmentPoint& point = run_map.points[mode];
    if (!alignment.Agrees(point.group)) continue;
    (*places)[mode] = alignment.T_reference_other * point.position;
  }
}

}  // namespace

bool IsDeformable(const RunMap& run_map) {
  return std::ssize(run_map.points) > kPartModes && WorstSd(run_map) > kDeformedSd;
}

std::optional<RunMapAlignment> AlignRunMap(const AlignmentPoints& reference,
                                           const RunMap& run_map,
                                           double area_m2,
                                           const AlignmentOptions& options) {
  RunMapAlignment result;
  result.deformed = IsDeformable(run_map);
  if (!result.deformed) {
    std::optional<Alignment> whole = AlignByConsensus(reference, run_map.points, area_m2, options);
    if (!whole) return std::nullopt;
    result.alignment = *std::move(whole);
    return result;
  }
  IndexedVector<ModeIndex, Eigen::Vector2d> positions;
  for (const AlignmentPoint& point : run_map.points) positions.push_back(point.position);
  result.places.resize(positions.size());
  for (const std::vector<ModeIndex>& part : TileModes(positions, kPartModes)) {
    std::optional<Alignment> alignment =
        AlignByConsensus(reference, PointsOf(run_map, part), area_m2, options);
    if (!alignment || alignment->signatures.size() < kMinPartSignatures) continue;
    AddPlaces(*alignment, run_map, part, &result.places);
    if (alignment->signatures.size() <= result.alignment.signatures.size()) continue;
    result.alignment = *std::move(alignment);
  }
  if (result.alignment.signatures.empty()) return std::nullopt;
  return result;
}

}  // namespace shiftmap
