// SPDX-License-Identifier: Apache-2.0
#include "mapper/covariance/gauge.h"

#include <Eigen/Eigenvalues>
#include <utility>

#include "mapstore/geometry/covariance.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/run/trajectory.h"

namespace shiftmap {
namespace {

constexpr double kFloorSd = 1e-3;  // [m]
constexpr double kGaugeSd = 1e-4;  // How firmly a prior holds the frame. [m]

Eigen::VectorXd Stacked(const std::vector<Eigen::Vector2d>& positions) {
  Eigen::VectorXd stacked(static_cast<Eigen::Index>(2 * positions.size()));
  for (std::size_t i = 0; i < positions.size(); ++i) {
    stacked.segment<2>(static_cast<Eigen::Index>(2 * i)) = positions[i];
  }
  return stacked;
}

// W with WᵀW = P⁻¹ but for what is known better than a floor.
Eigen::MatrixXd Whitening(const Eigen::MatrixXd& cov) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(Symmetrized(cov));
  const Eigen::VectorXd sqrt_information =
      solver.eigenvalues().cwiseMax(kFloorSd * kFloorSd * 0.1).cwiseSqrt().cwiseInverse();
  return sqrt_information.asDiagonal() * solver.eigenvectors().transpose();
}

}  // namespace

std::optional<Eigen::VectorXd> AlignedDifference(const std::vector<Eigen::Vector2d>& positions,
                                                 const std::vector<Eigen::Vector2d>& others) {
  std::vector<PointPair> pairs;
  for (std::size_t i = 0; i < positions.size(); ++i) pairs.push_back({positions[i], others[i]});
  const StatusOr<Se2> T_own_other = AlignRigid2d(pairs);
  if (!T_own_other.ok()) return std::nullopt;
  Eigen::VectorXd difference(2 * std::ssize(positions));
  for (std::size_t i = 0; i < positions.size(); ++i) {
    difference.segment<2>(static_cast<Eigen::Index>(2 * i)) =
        *T_own_other * others[i] - positions[i];
  }
  return difference;
}

Eigen::Matrix2d ReferBlock(const STransformation& change,
                           ModeIndex a,
                           ModeIndex b,
                           const Eigen::Matrix2d& cov_a_b) {
  const Eigen::Matrix2d block = change.Refer(a.value(), b.value(), cov_a_b);
  if (a != b) return block;
  return Symmetrized(block) + kFloorSd * kFloorSd * Eigen::Matrix2d::Identity();
}

Eigen::MatrixXd ReferToPositions(const std::vector<Eigen::Vector2d>& positions,
                                 Eigen::MatrixXd cov) {
  const Eigen::MatrixXd G = GaugeDirections(positions);
  const STransformation change(G, cov * G);
  cov.triangularView<Eigen::Lower>() -= G * change.W.transpose() + change.W * G.transpose();
  cov.triangularView<Eigen::StrictlyUpper>() = cov.transpose();
  cov.diagonal().array() += kFloorSd * kFloorSd;
  return cov;
}

Eigen::MatrixXd AddScaleUncertainty(const std::vector<Eigen::Vector2d>& positions,
                                    double sd_scale,
                                    const Eigen::MatrixXd& cov) {
  const Eigen::VectorXd q = OffsetsFromCentroid(positions);
  return cov + sd_scale * sd_scale * q * q.transpose();
}

Eigen::MatrixXd FreeGauge(const std::vector<Eigen::Vector2d>& positions,
                          double sd_scale,
                          const Eigen::MatrixXd& cov) {
  constexpr double kFreeSd = 10.0;
  Eigen::MatrixXd result = AddScaleUncertainty(positions, sd_scale, cov);
  const Eigen::MatrixXd G = GaugeDirections(positions);
  result += kFreeSd * kFreeSd * G * G.transpose();
  return result;
}

GraphPrior MakeLocatedPrior(const std::vector<ModeIndex>& modes,
                            const std::vector<Eigen::Vector2d>& positions,
                            const Eigen::MatrixXd& cov) {
  return {modes, Stacked(positions), Whitening(cov)};
}

std::vector<GraphPrior> HoldModes(const std::vector<ModeIndex>& modes,
                                  const std::vector<Eigen::Vector2d>& positions,
                                  double sd_m) {
  std::vector<GraphPrior> priors;
  for (std::size_t i = 0; i < modes.size(); ++i) {
    priors.push_back(
        {{modes[i]}, positions[i], Eigen::MatrixXd(Eigen::Matrix2d::Identity() / sd_m)});
  }
  return priors;
}

GraphPrior MakeGraphPrior(const std::vector<ModeIndex>& modes,
                          const std::vector<Eigen::Vector2d>& positions,
                          const Eigen::MatrixXd& cov) {
  const Eigen::MatrixXd G = GaugeDirections(positions);
  const Eigen::MatrixXd projector =
      Eigen::MatrixXd::Identity(cov.rows(), cov.cols()) - G * G.transpose();
  // Where the frame of `cov` was held does not matter: what it says of the gauge of these positions
  // goes before it is inverted. Its inverse would tell of it in every other direction too.
  const Eigen::MatrixXd whitening = Whitening(projector * cov * projector) * projector;
  Eigen::MatrixXd sqrt_information(whitening.rows() + 3, whitening.cols());
  sqrt_information << whitening, G.transpose() / kGaugeSd;
  return {modes, Stacked(positions), std::move(sqrt_information)};
}

}  // namespace shiftmap
