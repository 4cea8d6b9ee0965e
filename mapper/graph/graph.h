// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <limits>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "localizer/models/motion_model.h"
#include "mapper/graph/sensor_bias.h"
#include "mapper/graph/solver_limits.h"
#include "mapper/index.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/run/run.h"

namespace shiftmap {

class GraphPosterior;
class ReducedSystem;

/// Unknowns of a run in addition to its poses: correction (3) and sensor bias (3).
inline constexpr int kRunCalibration = 6;
inline constexpr int kRangeScaleRow = 3 + kLogRangeScale;  ///< Among these.

/// One run's chain of poses in the graph.
struct GraphRun {
  /// T_map_vehicle at every key frame. In: the start. Out: the solution.
  IndexedVector<FrameIndex, Se2> poses;
  IndexedVector<FrameIndex, MotionIncrement> motions;  ///< motions[i]: from poses[i] to [i + 1].

  /// Correction to the calibration the motions were integrated with: (log scale_v, log scale_omega,
  /// lag_s), with a Gaussian prior.
  Eigen::Vector3d correction = Eigen::Vector3d::Zero();
  Eigen::Vector3d correction_prior_mean = Eigen::Vector3d::Zero();
  Eigen::Vector3d correction_prior_sd = Eigen::Vector3d::Ones();

  /// Systematic errors of this vehicle's sensor, with a zero-mean Gaussian prior.
  SensorBias sensor_bias = SensorBias::Zero();
  SensorBias sensor_bias_sd = SensorBias::Ones();

  /// Divides the losses of this run's motions and observations: correlated errors carry less
  /// information than independent ones of the same noise.
  double variance_factor = 1.0;
};

/// An observation, switched to the mode that the selector names.
struct GraphObservation {
  RunIndex run;
  FrameIndex frame;
  ModeIndex mode;
  Observation observation;
  Eigen::Matrix2d cov_z = Eigen::Matrix2d::Identity();
  double mean_squared_bearing = 0.0;  ///< b̄² of the run. [rad²]
};

/// What is known of some modes beforehand: a joint Gaussian, as a previous map version has it.
struct GraphPrior {
  GraphPrior() = default;
  GraphPrior(std::vector<ModeIndex> of_modes, Eigen::VectorXd mean_m, Eigen::MatrixXd whitening)
      : modes(std::move(of_modes)),
        mean(std::move(mean_m)),
        sqrt_information(std::move(whitening)),
        information(sqrt_information.transpose() * sqrt_information) {}

  std::vector<ModeIndex> modes;
  Eigen::VectorXd mean;              ///< Stacked (x, y). [m]
  Eigen::MatrixXd sqrt_information;  ///< W; rows: whitened residuals. [1/m]
  Eigen::MatrixXd information;       ///< WᵀW, which every linearization takes. [1/m²]
};

/// The continuous part of the mapping problem, IJRR (21): poses and mode positions that minimize
///
///   Σ ‖Log((T_i Δ_i(c))⁻¹ T_{i+1})‖²_Σi  +  Σ ρ(‖z - h(T_f, p_m, b)‖²_R)  +  priors
///
/// with ρ Cauchy's loss (robust_loss.h): a misread signature must not bend the map.
struct Graph {
  IndexedVector<RunIndex, GraphRun> runs;
  IndexedVector<ModeIndex, Eigen::Vector2d> modes;  ///< p_map_landmark. [m]
  IndexedVector<ObservationIndex, GraphObservation> observations;
  std::vector<GraphPrior> priors;  ///< Independent of each other.

  /// Without a prior the frame is fixed by holding the first pose of this run.
  RunIndex anchor_run;

  /// No loop is closed: each mode is seen for a moment, not again after a while. Steps then go
  /// along the chain of poses (open_chain.h), and lead to the minimum from dead reckoning.
  bool open = false;

  /// What minimizes the graph and tells its posterior.
  SolverKind solver = SolverKind::kSchur;

  /// On which segments are eliminated; results do not depend on it. SolverKind::kCeres takes one.
  int threads = 1;

  /// Residual, in standard deviations, at which the loss turns from square to logarithm
  /// (robust_loss.h).
  double loss_scale = 2.5;

  /// Residual, in standard deviations, beyond which an observation does not pull: an outlier. Not
  /// for values that may be far from the minimum.
  double loss_reach = std::numeric_limits<double>::infinity();
};

struct GraphSummary {
  /// Infinite of a graph that is in no finite numbers, which is then left as it was.
  double initial_cost = 0.0;
  double final_cost = 0.0;
  int iterations = 0;
  bool converged = false;
};

/// Minimizes graphs one after the other, and keeps what the next may use of the last: graphs of the
/// same shape share the order of elimination, and similar ones a factor (ReducedSystem).
class GraphSolver {
 public:
  GraphSolver();
  ~GraphSolver();

  /// Minimizes the graph in place, by Graph::solver. kSchur: Gauss-Newton on the eliminated graph
  /// (schur_system.h), iteratively reweighted for the loss. Where a step does not go down even when
  /// it is halved, steps are damped (Levenberg, Marquardt). kCeres: SolveGraphByCeres(). Same
  /// graphs in the same order, same bits.
  GraphSummary Solve(const SolverLimits& limits, Graph* graph);

  /// As LinearizeGraph(), with the order of elimination of the last graph where that will do.
  std::unique_ptr<GraphPosterior> Linearize(const Graph& graph);

 private:
  std::unique_ptr<ReducedSystem> reduced_;
  bool near_minimum_ = false;  // Where the last graph was left.
};

/// One graph by itself, as GraphSolver::Solve().
GraphSummary SolveGraph(const SolverLimits& limits, Graph* graph);

/// The same with Ceres' trust region (Levenberg-Marquardt), whatever Graph::solver is.
GraphSummary SolveGraphByCeres(const SolverLimits& limits, Graph* graph);

/// Sums of squared standardized residuals by kind, and how many degrees of freedom each kind has
/// left after the fit: their ratio is near 1 if the kind's noise is what the graph was told. And
/// how many residuals of the kind there are.
struct ResidualStatistics {
  enum Kind { kTranslation, kYaw, kRange, kBearing, kPosition, kKinds };
  Eigen::Array<double, kKinds, 1> sum_of_squares = Eigen::Array<double, kKinds, 1>::Zero();
  Eigen::Array<double, kKinds, 1> redundancy = Eigen::Array<double, kKinds, 1>::Zero();
  Eigen::Array<double, kKinds, 1> count = Eigen::Array<double, kKinds, 1>::Zero();

  ResidualStatistics& operator+=(const ResidualStatistics& other) {
    sum_of_squares += other.sum_of_squares;
    redundancy += other.redundancy;
    count += other.count;
    return *this;
  }
};

using RunStatistics = IndexedVector<RunIndex, ResidualStatistics>;

/// The statistics of each run at the graph's present values. The redundancy of each kind of
/// residual, n - tr(J_kind Σ J_kindᵀ), is estimated by what the fit leaves of `samples` > 0 draws
/// of noise on the residuals (seeded; mapper/METHOD.md, 5). Precondition: every mode is
/// observed or in the prior.
/// @param solver  Has just solved the graph or a similar one. May be null.
/// @return Nothing where LinearizeGraph() has none.
std::optional<RunStatistics> ComputeRunStatistics(const Graph& graph,
                                                  int samples,
                                                  std::uint64_t seed,
                                                  GraphSolver* solver = nullptr);

}  // namespace shiftmap
