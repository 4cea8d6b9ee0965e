// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "mapper/graph/graph.h"
#include "mapper/graph/graph_posterior.h"
#include "mapstore/map/joint_covariance.h"

namespace shiftmap {

/// Modes whose joint covariance a larger map has: what a vehicle uses at a time are fewer.
inline constexpr int kTileModes = 128;

/// How well a graph's modes are known against each other. Single differences are solved for on the
/// factor, and most of them need not be: samples of the posterior bound them.
class ModeDifferences {
 public:
  /// Around the graph's present values, which must outlive this. Nothing if they do not determine
  /// the modes. Precondition: every mode is observed or in the prior.
  /// @param solver  Has just solved the graph.
  static std::optional<ModeDifferences> Of(const Graph& graph, GraphSolver* solver);

  /// Covariance of p_a - p_b. [m²]
  Eigen::Matrix2d Covariance(ModeIndex a, ModeIndex b) const;

  /// The same, where there are samples by these: a standard deviation is an eighth off.
  Eigen::Matrix2d ApproximateCovariance(ModeIndex a, ModeIndex b) const {
    return samples_.cols() == 0 ? Covariance(a, b) : SampledCovariance(a, b, 1.0);
  }

  /// Less and more than Covariance(), but with probability 1e-5: a quarter and four times the mean
  /// square of 32 seeded samples, as χ² of 32 degrees of freedom is seldom that far from its mean.
  /// Without samples zero and as good as infinite. [m²]
  Eigen::Matrix2d MinCovariance(ModeIndex a, ModeIndex b) const {
    return SampledCovariance(a, b, 1.0 / kSafety);
  }
  Eigen::Matrix2d MaxCovariance(ModeIndex a, ModeIndex b) const {
    return SampledCovariance(a, b, kSafety);
  }

 private:
  static constexpr double kSafety = 4.0;

  explicit ModeDifferences(std::unique_ptr<GraphPosterior> posterior)
      : posterior_(std::move(posterior)) {}

  // `factor` times what the samples say.
  Eigen::Matrix2d SampledCovariance(ModeIndex a, ModeIndex b, double factor) const;

  std::unique_ptr<GraphPosterior> posterior_;
  Eigen::MatrixXd samples_;  // Of the modes' errors, a column each. [m]
};

/// Modes in tiles of at most `size`, by halves of the longer side; every mode is in one.
std::vector<std::vector<ModeIndex>> TileModes(
    const IndexedVector<ModeIndex, Eigen::Vector2d>& positions, int size);

/// The disagreement of runs with each other and with the prior map beyond their covariances.
struct MapDisagreement {
  /// A variance factor of all runs that does not change how they weigh against the prior map.
  double factor = 1.0;

  /// Of modes that disagree by themselves: mean square of the differences of runs, or of visits,
  /// from the map. [m²]
  std::map<ModeIndex, Eigen::Matrix2d> of_modes;
};

/// The normal equations of a graph at its present values, of which MapCovariance() can be told, and
/// what else is to be known of them; null if it does not determine its modes in the numbers that a
/// computer has. Precondition: every mode is observed or in the prior.
std::unique_ptr<GraphPosterior> LinearizeForMap(const Graph& graph);

/// Adds what distortions are uncertain by.
/// @param root  Two rows a mode (BuildState::distortion_root), or empty. [m]
void AddDistortions(const Eigen::MatrixXd& root, Eigen::MatrixXd* covariance);

/// Covariance of a graph's modes as a map has it, in the order of Graph::modes. [m²]
///
/// It is referred to the positions as a whole (ReferToPositions), and has what no run tells of the
/// scale (AddScaleUncertainty).
///
/// Beyond kMaxJointModes modes it is that of modes in one tile of neighbours; between tiles it is
/// zero, and positive definite all the same, as any block-diagonal part of a covariance is.
/// @param posterior     LinearizeForMap() of the graph.
/// @param sd_scale      Of what no run tells of the scale. [-]
/// @param distortion    Root of what distortions add (EstimateDistortions), or empty. [m]
/// @param disagreement  With its factor F and prior information Λ the covariance of the graph's
///                      minimum is F P - (F - 1) P Λ P; not beyond kMaxJointModes. That of single
///                      modes is added.
JointCovariance MapCovariance(const Graph& graph,
                              const GraphPosterior& posterior,
                              double sd_scale,
                              const Eigen::MatrixXd& distortion,
                              const MapDisagreement& disagreement);

/// Whether a map says where its modes are: each is known to a hundred kilometres, and by a matrix
/// that is a covariance.
bool IsDetermined(const JointCovariance& covariance);

}  // namespace shiftmap
