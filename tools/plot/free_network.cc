// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/free_network.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr std::size_t kLeastModes = 3;

constexpr int kCommon = 4;

// Directions in which a network moves as a whole: along x, along y, about its centre, away from it.
Eigen::MatrixXd CommonDirections(const std::vector<Mode*>& modes) {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  for (const Mode* mode : modes) centre += mode->p_map_landmark;
  centre /= static_cast<double>(modes.size());
  Eigen::MatrixXd G(2 * std::ssize(modes), kCommon);
  for (std::size_t i = 0; i < modes.size(); ++i) {
    const Eigen::Vector2d p = modes[i]->p_map_landmark - centre;
    G.middleRows<2>(static_cast<Eigen::Index>(2 * i)) << 1.0, 0.0, -p.y(), p.x(),  //
        0.0, 1.0, p.x(), p.y();
  }
  return G;
}

// Returns the standard deviation of the scale.
double Free(const Eigen::MatrixXd& P, const std::vector<Mode*>& modes) {
  const Eigen::MatrixXd G = CommonDirections(modes);
  const Eigen::LDLT<Eigen::Matrix4d> normal(G.transpose() * G);
  if (normal.vectorD().minCoeff() <= 0.0) return 0.0;  // All at one place.
  const Eigen::MatrixXd A = normal.solve(G.transpose());
  const Eigen::MatrixXd AP = A * P;
  const Eigen::Matrix4d common = AP * A.transpose();
  for (std::size_t i = 0; i < modes.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(2 * i);
    const Eigen::Matrix<double, 2, kCommon> g = G.middleRows<2>(row);
    const Eigen::Matrix2d shared = g * AP.middleCols<2>(row);
    const Eigen::Matrix2d cov =
        P.block<2, 2>(row, row) - shared - shared.transpose() + g * common * g.transpose();
    modes[i]->cov_p_map_landmark = Symmetrized(cov);
  }
  return std::sqrt(std::max(0.0, common(kCommon - 1, kCommon - 1)));
}

}  // namespace

FreeMap FreeNetwork(const MapContent& content) {
  FreeMap free{content};
  std::vector<Mode*> all;
  for (LandmarkGroup& group : free.content.groups) {
    for (Mode& mode : group.modes) all.push_back(&mode);
  }
  std::size_t largest = 0;
  for (const std::vector<int>& network : content.covariance.Components()) {
    if (network.size() < kLeastModes) continue;
    std::vector<Mode*> modes;
    for (const int index : network) modes.push_back(all[static_cast<std::size_t>(index)]);
    const double scale_sd = Free(content.covariance.Dense(network), modes);
    if (network.size() > largest) free.scale_sd = scale_sd;
    largest = std::max(largest, network.size());
  }
  std::vector<Eigen::Matrix2d> diagonal;
  for (const Mode* mode : all) diagonal.push_back(mode->cov_p_map_landmark);
  free.content.covariance = JointCovariance(std::move(diagonal), {});
  return free;
}

}  // namespace shiftmap
