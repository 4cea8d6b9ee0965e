// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/map_consistency.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <cstddef>

#include "mapper/covariance/gauge.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/run/trajectory.h"

namespace shiftmap {

std::optional<MapShapeError> MeasureMapShape(const MapContent& content,
                                             const std::map<Signature, Eigen::Vector2d>& places) {
  std::vector<int> modes;
  std::vector<Eigen::Vector2d> positions;
  std::vector<PointPair> pairs;
  int first = 0;
  for (const LandmarkGroup& group : content.groups) {
    const auto place = places.find(group.signature);
    if (place != places.end() && group.modes.size() == 1) {
      modes.push_back(first);
      positions.push_back(group.modes.front().p_map_landmark);
      pairs.push_back({positions.back(), place->second});
    }
    first += static_cast<int>(group.modes.size());
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
  const Eigen::MatrixXd covariance = shape.transpose() * content.covariance.Dense(modes) * shape;
  MapShapeError result;
  result.landmarks = static_cast<int>(positions.size());
  result.rms_m = std::sqrt(of_shape.squaredNorm() / static_cast<double>(positions.size()));
  result.nees = of_shape.dot(covariance.llt().solve(of_shape));
  result.dof = static_cast<double>(of_shape.size());
  return result;
}

}  // namespace shiftmap
