// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/free_network.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "mapstore/geometry/covariance.h"
#include "mapstore/geometry/inner_constraints.h"

namespace shiftmap {
namespace {

constexpr std::size_t kLeastModes = 3;
constexpr double kLeastSize = 1e-6;  // Below it, all modes are at one place. [m]

// Translation along x and y, rotation, growth.
constexpr int kCommon = 4;

// Modes that the covariance connects.
struct Network {
  std::vector<Mode*> modes;
  double size_m = 0.0;  // Root of the sum of squared offsets from the centroid.
  Eigen::MatrixXd G;    // Directions in which all of them move together, orthonormal columns.
};

Network MakeNetwork(const std::vector<int>& indices, const std::vector<Mode*>& all) {
  Network network;
  std::vector<Eigen::Vector2d> positions;
  for (const int index : indices) {
    network.modes.push_back(all[static_cast<std::size_t>(index)]);
    positions.push_back(network.modes.back()->p_map_landmark);
  }
  const Eigen::VectorXd offsets = OffsetsFromCentroid(positions);
  network.size_m = offsets.norm();
  network.G.resize(offsets.size(), kCommon);
  network.G << GaugeDirections(positions), offsets / network.size_m;
  return network;
}

// P G, of as many rows as G; without the matrix P, which would be large.
Eigen::MatrixXd Times(const JointCovariance& P, const Eigen::MatrixXd& G) {
  Eigen::MatrixXd product(G.rows(), G.cols());
  const auto row = [](int mode) { return Eigen::Index{2} * mode; };
  for (int mode = 0; mode < P.size(); ++mode) {
    product.middleRows<2>(row(mode)) = P.Block(mode, mode) * G.middleRows<2>(row(mode));
  }
  for (const JointCovariance::CrossBlock& block : P.cross_blocks()) {
    product.middleRows<2>(row(block.row)) += block.value * G.middleRows<2>(row(block.column));
    product.middleRows<2>(row(block.column)) +=
        block.value.transpose() * G.middleRows<2>(row(block.row));
  }
  return product;
}

// Returns the standard deviation of the scale.
// @param PG  Rows of the network. [m²]
double Free(const Network& network, const Eigen::MatrixXd& PG) {
  const STransformation change(network.G, PG);
  for (std::size_t i = 0; i < network.modes.size(); ++i) {
    const int index = static_cast<int>(i);
    Eigen::Matrix2d& cov = network.modes[i]->cov_p_map_landmark;
    cov = Symmetrized(change.Refer(index, index, cov));
  }
  const double variance = network.G.col(kCommon - 1).dot(PG.col(kCommon - 1));
  return std::sqrt(std::max(0.0, variance)) / network.size_m;
}

}  // namespace

FreeMap FreeNetwork(const MapContent& content) {
  FreeMap free{content, !content.covariance.cross_blocks().empty()};
  std::vector<Mode*> all;
  for (LandmarkGroup& group : free.content.groups) {
    for (Mode& mode : group.modes) all.push_back(&mode);
  }
  const std::vector<std::vector<int>> components = content.covariance.Components();
  std::vector<Network> networks;
  // Of all networks: no block connects two of them.
  Eigen::MatrixXd G = Eigen::MatrixXd::Zero(2 * std::ssize(all), kCommon);
  for (const std::vector<int>& indices : components) {
    networks.push_back(indices.size() < kLeastModes ? Network{} : MakeNetwork(indices, all));
    const Network& network = networks.back();
    if (network.size_m < kLeastSize) continue;
    for (std::size_t i = 0; i < indices.size(); ++i) {
      G.middleRows<2>(Eigen::Index{2} * indices[i]) =
          network.G.middleRows<2>(static_cast<Eigen::Index>(2 * i));
    }
  }
  const Eigen::MatrixXd PG = Times(content.covariance, G);
  std::size_t largest = 0;
  for (std::size_t n = 0; n < components.size(); ++n) {
    const std::vector<int>& indices = components[n];
    if (networks[n].size_m < kLeastSize) continue;
    Eigen::MatrixXd rows(networks[n].G.rows(), kCommon);
    for (std::size_t i = 0; i < indices.size(); ++i) {
      rows.middleRows<2>(static_cast<Eigen::Index>(2 * i)) =
          PG.middleRows<2>(Eigen::Index{2} * indices[i]);
    }
    const double scale_sd = Free(networks[n], rows);
    if (indices.size() > largest) free.scale_sd = scale_sd;
    largest = std::max(largest, indices.size());
  }
  std::vector<Eigen::Matrix2d> diagonal;
  for (const Mode* mode : all) diagonal.push_back(mode->cov_p_map_landmark);
  free.content.covariance = JointCovariance(std::move(diagonal), {});
  return free;
}

}  // namespace shiftmap
