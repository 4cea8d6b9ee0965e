// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/run_maps.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <cstddef>
#include <vector>

#include "mapper/calibration/noise_calibration.h"
#include "mapper/covariance/gauge.h"
#include "mapper/frontend/mapping_run.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/run_maps/single_run.h"
#include "mapper/run_maps/variance_factor.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/run/trajectory.h"

namespace shiftmap {

std::optional<RunMapError> MeasureRunMap(const Run& run,
                                         const std::map<Signature, Eigen::Vector2d>& places,
                                         const MapperOptions& options) {
  const IndexedVector<GroupIndex, Signature> signatures = CollectSignatures({&run}, {});
  const MappingRun arranged = MakeMappingRun(run, signatures, options.front_end);
  if (arranged.sightings.empty()) return std::nullopt;
  std::vector<BuildState> builds = {MapSingleRun(arranged, signatures.size(), options)};
  RaiseNoiseByVehicle(&builds);
  std::optional<RunMap> run_map = MakeRunMap(options, std::move(builds.front()));
  if (!run_map) return std::nullopt;

  std::vector<Eigen::Index> rows;
  std::vector<Eigen::Vector2d> positions;
  std::vector<PointPair> pairs;
  for (const ModeIndex i : run_map->points.indices()) {
    const GroupIndex group(run_map->points[i].group);
    const auto place = places.find(signatures[group]);
    if (place == places.end() || run_map->build.modes[group].size() != 1) continue;
    positions.push_back(run_map->points[i].position);
    pairs.push_back({positions.back(), place->second});
    rows.insert(rows.end(), {2 * i, 2 * i + 1});
  }
  if (positions.size() < 3) return std::nullopt;
  const StatusOr<Se2> T_map_survey = AlignRigid2d(pairs);
  if (!T_map_survey.ok()) return std::nullopt;

  Eigen::VectorXd error(2 * std::ssize(positions));
  for (std::size_t i = 0; i < positions.size(); ++i) {
    error.segment<2>(static_cast<Eigen::Index>(2 * i)) =
        *T_map_survey * pairs[i].p_b - positions[i];
  }
  const Eigen::MatrixXd shape = ShapeDirections(positions);
  const Eigen::VectorXd of_shape = shape.transpose() * error;
  const Eigen::MatrixXd covariance = shape.transpose() * run_map->covariance(rows, rows) * shape;
  RunMapError result;
  result.landmarks = static_cast<int>(positions.size());
  result.rms_m = std::sqrt(of_shape.squaredNorm() / static_cast<double>(positions.size()));
  result.nees = of_shape.dot(covariance.llt().solve(of_shape));
  result.dof = static_cast<double>(of_shape.size());
  result.variance_factor = VarianceFactor(options, run_map->build);
  return result;
}

}  // namespace shiftmap
