// SPDX-License-Identifier: Apache-2.0
#include <ceres/crs_matrix.h>

#include <Eigen/Cholesky>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <random>

#include "mapper/graph/graph.h"
#include "mapper/graph/graph_problem.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

using Sparse = Eigen::SparseMatrix<double>;
using RowSparse = Eigen::SparseMatrix<double, Eigen::RowMajor>;

struct Linearization {
  RowSparse J;
  Eigen::VectorXd residuals;
};

Linearization Linearize(ceres::Problem& problem,
                        const std::vector<double*>& parameters,
                        const std::vector<ceres::ResidualBlockId>& residual_blocks,
                        bool apply_loss) {
  ceres::Problem::EvaluateOptions options;
  options.apply_loss_function = apply_loss;
  options.parameter_blocks = parameters;
  options.residual_blocks = residual_blocks;
  options.num_threads = 1;
  ceres::CRSMatrix jacobian;
  std::vector<double> residuals;
  SHIFTMAP_CHECK(problem.Evaluate(options, nullptr, &residuals, nullptr, &jacobian),
                 "evaluation failed");
  const Eigen::Map<const RowSparse> map(jacobian.num_rows,
                                        jacobian.num_cols,
                                        static_cast<Eigen::Index>(jacobian.values.size()),
                                        jacobian.rows.data(),
                                        jacobian.cols.data(),
                                        jacobian.values.data());
  return {RowSparse(map),
          Eigen::Map<const Eigen::VectorXd>(residuals.data(),
                                            static_cast<Eigen::Index>(residuals.size()))};
}

// H = [A B; Bᵀ C] over (poses; the rest). The rest's marginal information is C - Bᵀ A⁻¹ B.
class Elimination {
 public:
  Elimination(const Sparse& H, Eigen::Index poses) {
    const Eigen::Index rest = H.cols() - poses;
    poses_.compute(H.topLeftCorner(poses, poses));
    SHIFTMAP_CHECK(poses_.info() == Eigen::Success, "the poses are not determined");
    const Eigen::MatrixXd B = Eigen::MatrixXd(H.topRightCorner(poses, rest));
    back_substitution_ = poses_.solve(B);
    const Eigen::MatrixXd schur =
        Eigen::MatrixXd(H.bottomRightCorner(rest, rest)) - B.transpose() * back_substitution_;
    rest_.compute(schur);
    SHIFTMAP_CHECK(rest_.info() == Eigen::Success, "the modes are not determined");
  }

  Eigen::MatrixXd RestCovariance() const {
    return rest_.solve(Eigen::MatrixXd::Identity(rest_.rows(), rest_.cols()));
  }

  // A draw of N(0, H⁻¹).
  template <typename Random>
  Eigen::VectorXd Sample(Random& random) const {
    std::normal_distribution<double> normal;
    const auto draw = [&](Eigen::Index size) {
      Eigen::VectorXd z(size);
      for (double& value : z) value = normal(random);
      return z;
    };
    const Eigen::Index poses = back_substitution_.rows();
    const Eigen::VectorXd rest = rest_.matrixU().solve(draw(rest_.rows()));
    Eigen::VectorXd sample(poses + rest.size());
    const Eigen::VectorXd permuted = poses_.matrixU().solve(draw(poses));
    sample.head(poses) = poses_.permutationPinv() * permuted - back_substitution_ * rest;
    sample.tail(rest.size()) = rest;
    return sample;
  }

 private:
  Eigen::SimplicialLLT<Sparse> poses_;
  Eigen::MatrixXd back_substitution_;
  Eigen::LLT<Eigen::MatrixXd> rest_;
};

// Outliers say nothing about the noise of the rest: rows of an observation beyond this are not
// counted.
constexpr double kInlierProbability = 0.999;
constexpr int kNotCounted = -1;

// Kind of every residual row: three per motion, two per observation.
std::vector<int> RowKinds(const Graph& graph, std::size_t motions) {
  const double gate = ChiSquareQuantile(kInlierProbability, 2);
  std::vector<int> kinds;
  for (std::size_t i = 0; i < motions; ++i) {
    kinds.insert(kinds.end(),
                 {ResidualStatistics::kTranslation,
                  ResidualStatistics::kTranslation,
                  ResidualStatistics::kYaw});
  }
  for (const GraphObservation& item : graph.observations) {
    if (SquaredResidual(graph, item) > gate) {
      kinds.insert(kinds.end(), {kNotCounted, kNotCounted});
    } else if (item.observation.kind == Observation::Kind::kCartesian) {
      kinds.insert(kinds.end(), {ResidualStatistics::kPosition, ResidualStatistics::kPosition});
    } else {
      kinds.insert(kinds.end(), {ResidualStatistics::kRange, ResidualStatistics::kBearing});
    }
  }
  return kinds;
}

}  // namespace

GraphPosterior ComputeGraphPosterior(const Graph& graph, int samples, std::uint64_t seed) {
  GraphProblem problem(graph);
  std::vector<double*> parameters = problem.FreePoses();
  const auto poses = static_cast<Eigen::Index>(3 * parameters.size());
  const std::vector<double*> rest = problem.CalibrationsAndModes();
  parameters.insert(parameters.end(), rest.begin(), rest.end());

  std::vector<ceres::ResidualBlockId> all;
  problem.problem().GetResidualBlocks(&all);
  const Sparse J_all = Linearize(problem.problem(), parameters, all, true).J;
  const Elimination elimination(Sparse(J_all.transpose() * J_all), poses);

  GraphPosterior posterior;
  const auto mode_rows = static_cast<Eigen::Index>(2 * graph.modes.size());
  posterior.mode_covariance = elimination.RestCovariance().bottomRightCorner(mode_rows, mode_rows);
  if (samples == 0) return posterior;

  std::vector<ceres::ResidualBlockId> measured = problem.motions();
  measured.insert(measured.end(), problem.observations().begin(), problem.observations().end());
  const Linearization linear = Linearize(problem.problem(), parameters, measured, false);
  const std::vector<int> kinds = RowKinds(graph, problem.motions().size());
  std::mt19937_64 random(seed);
  Eigen::VectorXd explained = Eigen::VectorXd::Zero(linear.residuals.size());
  for (int i = 0; i < samples; ++i) {
    explained += (linear.J * elimination.Sample(random)).cwiseAbs2() / samples;
  }
  for (std::size_t row = 0; row < kinds.size(); ++row) {
    if (kinds[row] == kNotCounted) continue;
    const auto at = static_cast<Eigen::Index>(row);
    posterior.statistics.sum_of_squares[kinds[row]] += linear.residuals[at] * linear.residuals[at];
    posterior.statistics.redundancy[kinds[row]] += 1.0 - explained[at];
  }
  return posterior;
}

}  // namespace shiftmap
