// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mapper/graph/graph.h"
#include "mapstore/geometry/inner_constraints.h"

namespace shiftmap {

/// How other places of the same points differ from positions once they are rigidly aligned to them,
/// two rows each. Nothing if these do not determine the rotation. [m]
std::optional<Eigen::VectorXd> AlignedDifference(const std::vector<Eigen::Vector2d>& positions,
                                                 const std::vector<Eigen::Vector2d>& others);

/// Refers a joint covariance of positions to the positions as a whole, P' = (I - GGᵀ) P (I - GGᵀ)
/// with G the gauge directions: the inner-constraint solution of surveying. It does not depend on
/// which pose or landmark held the frame in the solve, and has the smallest trace of all choices
/// (Baarda: S-transformations and criterion matrices, 1973; Meissl: Zusammenfassung und Ausbau der
/// inneren Fehlertheorie eines Punkthaufens, 1969). A floor of 1 mm per axis keeps it positive
/// definite.
Eigen::MatrixXd ReferToPositions(const std::vector<Eigen::Vector2d>& positions,
                                 Eigen::MatrixXd cov);

/// Block (a, b) of ReferToPositions(), from that block of P. [m²]
/// @param change  Of GaugeDirections() of the positions.
Eigen::Matrix2d ReferBlock(const STransformation& change,
                           ModeIndex a,
                           ModeIndex b,
                           const Eigen::Matrix2d& cov_a_b);

/// Adds what no run tells: the scale of the map, which the sensors' own scale sets. All positions
/// move together along their offsets q from the centroid: P' = P + sd² q qᵀ.
/// @param sd_scale  Standard deviation of the scale. [-]
Eigen::MatrixXd AddScaleUncertainty(const std::vector<Eigen::Vector2d>& positions,
                                    double sd_scale,
                                    const Eigen::MatrixXd& cov);

/// The covariance of a run's positions before others hold it: AddScaleUncertainty(), and the gauge
/// floats by ten metres.
Eigen::MatrixXd FreeGauge(const std::vector<Eigen::Vector2d>& positions,
                          double sd_scale,
                          const Eigen::MatrixXd& cov);

/// The prior of a map version as a graph takes it: information P⁻¹ outside the gauge directions,
/// and the gauge held where it is.
/// @param modes  Of the graph that will use it, at the positions.
GraphPrior MakeGraphPrior(const std::vector<ModeIndex>& modes,
                          const std::vector<Eigen::Vector2d>& positions,
                          const Eigen::MatrixXd& cov);

/// The prior of some modes by themselves, information P⁻¹: they know where they are.
GraphPrior MakeLocatedPrior(const std::vector<ModeIndex>& modes,
                            const std::vector<Eigen::Vector2d>& positions,
                            const Eigen::MatrixXd& cov);

/// Holds modes of a graph where they are, each by itself.
/// @param sd_m  Per axis. [m]
std::vector<GraphPrior> HoldModes(const std::vector<ModeIndex>& modes,
                                  const std::vector<Eigen::Vector2d>& positions,
                                  double sd_m);

}  // namespace shiftmap
