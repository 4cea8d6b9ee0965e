// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/map_consistency.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <cmath>
#include <cstddef>

#include "mapper/covariance/gauge.h"

namespace shiftmap {
namespace {

// In which all positions neither move, turn nor grow together, orthonormal columns.
Eigen::MatrixXd ShapeDirections(const std::vector<Eigen::Vector2d>& positions) {
  Eigen::MatrixXd others(2 * std::ssize(positions), 4);
  others << GaugeDirections(positions), OffsetsFromCentroid(positions);
  const Eigen::MatrixXd basis = Eigen::HouseholderQR<Eigen::MatrixXd>(others).householderQ();
  return basis.rightCols(others.rows() - others.cols());
}

}  // namespace

std::optional<MapShapeError> MeasureMapShape(const MapContent& content,
                                             const std::map<Signature, Eigen::Vector2d>& places) {
  std::vector<int> modes;
  std::vector<Eigen::Vector2d> positions;
  std::vector<Eigen::Vector2d> stood;
  int first = 0;
  for (const LandmarkGroup& group : content.groups) {
    const auto place = places.find(group.signature);
    if (place != places.end() && group.modes.size() == 1) {
      modes.push_back(first);
      positions.push_back(group.modes.front().p_map_landmark);
      stood.push_back(place->second);
    }
    first += static_cast<int>(group.modes.size());
  }
  if (positions.size() < 3) return std::nullopt;
  const std::optional<Eigen::VectorXd> error = AlignedDifference(positions, stood);
  if (!error) return std::nullopt;
  const Eigen::MatrixXd shape = ShapeDirections(positions);
  const Eigen::VectorXd of_shape = shape.transpose() * *error;
  const Eigen::MatrixXd covariance = shape.transpose() * content.covariance.Dense(modes) * shape;
  MapShapeError result;
  result.landmarks = static_cast<int>(positions.size());
  result.rms_m = std::sqrt(of_shape.squaredNorm() / static_cast<double>(positions.size()));
  result.nees = of_shape.dot(covariance.llt().solve(of_shape));
  result.dof = static_cast<double>(of_shape.size());
  return result;
}

}  // namespace shiftmap
