// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/run_map_alignment.h"

#include <utility>

#include "mapper/covariance/gauge.h"
#include "mapper/covariance/mode_covariance.h"
#include "mapper/rows.h"

namespace shiftmap {
namespace {

// The modes of a part, with covariances relative to them as a whole.
AlignmentPoints PointsOf(const RunMap& run_map, const std::vector<ModeIndex>& part) {
  AlignmentPoints points;
  for (const ModeIndex mode : part) points.push_back(run_map.points[mode]);
  const std::vector<Eigen::Index> rows = RowsOf(part);
  const Eigen::MatrixXd cov = ReferToPositions(PositionsOf(points), run_map.covariance(rows, rows));
  for (const ModeIndex i : points.indices()) {
    points[i].cov = cov.block<2, 2>(RowOf(i), RowOf(i));
  }
  return points;
}

// Of a part's modes, those whose group agrees go where the alignment has them.
void AddPlaces(const Alignment& alignment,
               const RunMap& run_map,
               const std::vector<ModeIndex>& part,
               ModePlaces* places) {
  for (const ModeIndex mode : part) {
    const AlignmentPoint& point = run_map.points[mode];
    if (!alignment.Agrees(point.group)) continue;
    (*places)[mode] = alignment.T_reference_other * point.position;
  }
}

}  // namespace

bool IsDeformable(const RunMap& run_map, const AlignmentOptions& options) {
  return std::ssize(run_map.points) > options.part_modes &&
         WorstSd(run_map) > options.deformed_sd_m;
}

std::optional<RunMapAlignment> AlignRunMap(const AlignmentPoints& reference,
                                           const RunMap& run_map,
                                           double area_m2,
                                           const AlignmentOptions& options) {
  RunMapAlignment result;
  result.deformed = IsDeformable(run_map, options);
  if (!result.deformed) {
    std::optional<Alignment> whole = AlignByConsensus(reference, run_map.points, area_m2, options);
    if (!whole) return std::nullopt;
    result.alignment = *std::move(whole);
    return result;
  }
  result.places.resize(run_map.points.size());
  for (const std::vector<ModeIndex>& part :
       TileModes(PositionsOf(run_map.points), options.part_modes)) {
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
