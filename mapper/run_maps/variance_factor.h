// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <memory>
#include <optional>

#include "mapper/graph/graph_posterior.h"
#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// The covariance of the shape of a build's modes: of their changes Q δ = (I - GGᵀ) δ that neither
/// translate nor rotate nor scale all of them, which are the directions G.
class ShapeCovariance {
 public:
  /// Fewer modes have no shape.
  static constexpr std::size_t kMinModes = 3;

  /// What a shape leaves open: translation, rotation and scale.
  static constexpr int kGauge = 4;

  /// Nothing if the build does not determine its modes.
  /// @param graph  Solved, of kMinModes and more; it must outlive this.
  static std::optional<ShapeCovariance> Of(const Graph& graph);

  /// Qδ in standard deviations, of changes δ of the modes, two rows a mode.
  Eigen::MatrixXd Whiten(const Eigen::MatrixXd& changes) const {
    return llt_.matrixL().solve(changes - G_ * (G_.transpose() * changes));
  }

  /// The pseudo-inverse of the covariance of Qδ. [1/m²]
  Eigen::MatrixXd Information() const {
    return llt_.solve(Eigen::MatrixXd::Identity(G_.rows(), G_.rows())) - G_ * G_.transpose();
  }

  const GraphPosterior& posterior() const { return *posterior_; }

 private:
  ShapeCovariance() = default;

  std::unique_ptr<GraphPosterior> posterior_;
  Eigen::MatrixXd G_;
  Eigen::LLT<Eigen::MatrixXd> llt_;  // Of the covariance, and GGᵀ beside it.
};

/// By how much the covariance of a build's modes is to be multiplied so that it has the errors
/// that the runs themselves show: residuals that are correlated over time, or are not of the noise
/// that is assumed, make a map worse than its covariance P = H⁻¹ says. At least 1.
///
/// Sandwich estimate with clusters (Liang and Zeger 1986): each of B stretches of time has
/// residuals e_b that by themselves move the modes by δ_b = H⁻¹ J_bᵀ e_b, and Σ_b δ_b δ_bᵀ
/// estimates the covariance whatever the residuals of a stretch have in common:
///
///   factor = s(e) / mean over draws of s(ε - J H⁻¹ Jᵀ ε),   s(e) = Σ_b ‖Q δ_b‖² in standard
///   deviations,
///
/// draws of white noise ε: the fit takes as much from them as from the residuals.
double VarianceFactor(const Graph& graph, const ShapeCovariance& shape, std::uint64_t seed);

/// The same of a solved build.
double VarianceFactor(const MapperOptions& options, const BuildState& build);

}  // namespace shiftmap
