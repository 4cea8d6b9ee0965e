// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "mapper/graph/graph.h"
#include "mapper/graph/graph_posterior.h"
#include "mapper/graph/residuals.h"
#include "mapper/graph/rest_system.h"
#include "mapper/graph/robust_loss.h"
#include "mapper/graph/segment.h"

namespace shiftmap {

/// Poses between two separators. More make the rest smaller and let a segment see more modes.
inline constexpr int kSegmentPoses = 31;

/// A change of everything continuous in a graph.
struct GraphStep {
  std::vector<Eigen::VectorXd> poses;  ///< Per run ξ of every pose, T·Exp(ξ), three rows each.
  std::vector<Eigen::Vector<double, kRunCalibration>> calibrations;  ///< Per run, correction first.
  Eigen::VectorXd modes;                                             ///< (x, y) each. [m]
};

/// Noise on every standardized residual, a random sign each, and the step x = H⁻¹ Jᵀ ε that it
/// leads to, which has the covariance H⁻¹. What the fit leaves of it, ε - J x, is a residual of a
/// graph whose noise is right.
struct ResidualDraw {
  GraphResiduals noise;
  GraphStep step;
};

/// A step `factor` times as long.
GraphStep Scaled(GraphStep step, double factor);

/// Moves a graph's values along a step.
void Apply(const GraphStep& step, Graph* graph);

/// The normal equations of a graph, solved by nested elimination. A run's chain of poses is cut
/// into segments by separators; a segment couples with its two separators, its run's calibration
/// and the few modes seen from it, and is eliminated by itself. What is left over separators,
/// calibrations and modes is a small system, dense or sparse (RestSystem). Linear in the length of
/// runs, without a dense matrix over poses.
///
/// The loss of observations enters a step by its weights (iteratively reweighted least squares),
/// and the Gaussian around the values by its curvature (robust_loss.h).
class GraphElimination final : public GraphPosterior {
 public:
  /// @param graph     Must outlive this; its values may change, its shape may not.
  /// @param together  Lists of modes, all pairs in each of which VisitModeCovariance() is to tell.
  explicit GraphElimination(const Graph& graph, std::vector<std::vector<int>> together = {});

  /// Goes on with the small system of a graph of the same shape or another, whose factor may do.
  /// @param rest  May be null; then as above.
  GraphElimination(const Graph& graph, std::unique_ptr<RestSystem> rest);

  std::unique_ptr<RestSystem> TakeRest() { return std::move(rest_); }

  /// True if the system that this went on with has a factor in which the calibrations are held.
  /// DrawModes() and ModeDifferenceCovariance() may then be had without Linearize(): they are those
  /// given the calibrations, which runs that cross each other tell well.
  bool HoldsCalibrations() const { return rest_ && rest_->HoldsBorder(); }

  /// Linearizes at the present values and eliminates. False if something is not determined.
  bool Linearize() { return Eliminate(&RobustLoss::Curvature, 0.0) && rest_->Factorize(); }

  /// The same for DrawResiduals(), which are of this linearization whatever one the factor is of:
  /// where the calibrations are held that of an earlier one will do.
  bool LinearizeSimilar() {
    return Eliminate(&RobustLoss::Curvature, 0.0) && rest_->FactorizeSimilar();
  }

  /// Linearizes for a cost and a SimilarStep(), without solving the small system. False if a
  /// segment is not determined.
  /// @param damping  Share by which the diagonal of the normal equations is raised (Marquardt).
  bool LinearizeSegments(double damping = 0.0) { return Eliminate(&RobustLoss::Weight, damping); }

  /// The same with the curvature of the loss, for steps near a minimum: weights leave a fifth of
  /// the way and more to each next one.
  bool LinearizeNearMinimum() { return Eliminate(&RobustLoss::StepCurvature, 0.0); }

  /// What observations count for in the last linearization: weight or curvature of the loss.
  double WeightOf(double squared) const { return (loss_.*weighting_)(squared); }

  /// Half the sum of all losses at the last linearization.
  double cost() const { return cost_; }

  /// The same at the present values, a fraction of a linearization. NaN where LinearizeSegments()
  /// would have no cost.
  double PresentCost() const;

  /// By how much the cost would go down in the last SimilarStep() if it were as linearized.
  double ExpectedDecrease() const { return expected_decrease_; }

  /// The Gauss-Newton step from the last LinearizeSegments(), with the factor of an earlier
  /// linearization where that will do (RestSystem::SolveSimilar). Nothing if it is not determined.
  std::optional<GraphStep> SimilarStep();

  /// Draws of the noise. Precondition, here and in what follows: Linearize() succeeded.
  std::vector<ResidualDraw> DrawResiduals(int count, std::mt19937_64& random) const;

  /// What the fit leaves of draws, ε - J x each.
  std::vector<GraphResiduals> Left(const std::vector<ResidualDraw>& draws) const;

  // GraphPosterior.
  std::vector<GraphResiduals> DrawFitResiduals(int count, std::mt19937_64& random) const override {
    return Left(DrawResiduals(count, random));
  }
  Eigen::MatrixXd ModeStepsByBlock(const GraphResiduals& residuals,
                                   const FrameBlocks& block_of_frame,
                                   int blocks) const override;
  Eigen::MatrixXd ModeCovariance() const override;
  Eigen::MatrixXd ModeCovarianceTimes(const Eigen::MatrixXd& weights) const override;
  Eigen::MatrixXd CalibrationRoot() const override;
  Eigen::MatrixXd VisitedCovarianceTimes(const Eigen::MatrixXd& calibration_root,
                                         const Eigen::MatrixXd& weights) const override;
  Eigen::MatrixXd ModesByRangeScale(
      const std::vector<std::vector<std::size_t>>& runs) const override;

  /// As costly as the part of the factor that the two modes touch.
  Eigen::Matrix2d ModeDifferenceCovariance(int a, int b) const override;
  Eigen::MatrixXd DrawModes(int draws, std::mt19937_64& random) const override;

  /// As costly as Linearize().
  void VisitModeCovariance(const Eigen::MatrixXd& calibration_root,
                           const BlockVisitor& visitor) const override;
  Eigen::MatrixXd CalibrationInformationTimes(const Eigen::MatrixXd& weights) const override;

 private:
  class NoiseSum;

  // Frames [first, last] of a run, the outer two its separators; last == first if there is one
  // frame.
  struct Stretch {
    int run = 0;
    int first = 0;
    int last = 0;
    std::vector<int> observations;  // In frames [first, last), or [first, last] at a run's end.
    std::vector<int> boundary;      // In the rest: separators, calibration, modes; -1 if held.
    std::vector<int> slots;         // Per observation the first column of its mode in `boundary`.
    Segment segment;
  };

  int RestSize() const;
  Border Calibrations() const;
  void MakeStretches();
  void AddMode(int mode, Stretch* stretch);
  // What an observation's squared residual is multiplied by.
  using Weighting = double (RobustLoss::*)(double squared) const;

  // The poses' step inside a stretch, given its boundary's.
  using Inside =
      std::function<Eigen::VectorXd(std::size_t stretch, const Eigen::VectorXd& boundary)>;

  bool Eliminate(Weighting weighting, double damping);
  std::vector<Eigen::Matrix2d> RotationsOf(const Stretch& stretch) const;  // R_map_vehicle.
  MotionResidual::Linear MotionAt(const Stretch& stretch,
                                  const std::vector<Eigen::Matrix2d>& R_map_vehicle,
                                  int frame) const;
  ObservationResidual::Linear ObservationAt(const Stretch& stretch,
                                            const std::vector<Eigen::Matrix2d>& R_map_vehicle,
                                            int observation) const;
  double LinearizeStretch(const Stretch& stretch, SegmentSystem* system) const;
  // What adds Jᵀ ε of a stretch to the right sides of its poses and boundary, a column each.
  using NoiseOf = std::function<void(const Stretch& stretch, PoseRows* b, Eigen::MatrixXd* c)>;

  Eigen::MatrixXd SolveNoise(const NoiseOf& add_noise,
                             Eigen::MatrixXd rest,
                             std::vector<PoseRows>* inside) const;
  template <typename AddMotion, typename AddObservation>
  void VisitResiduals(const Stretch& stretch,
                      const AddMotion& add_motion,
                      const AddObservation& add_observation) const;
  Eigen::MatrixXd PriorNoise(int count, std::mt19937_64& random) const;
  double StretchCost(const Stretch& stretch) const;
  double PriorCost() const;
  Eigen::VectorXd PriorDifference(const GraphPrior& prior) const;
  std::vector<int> RowsOf(const std::vector<int>& modes) const;
  void AddPriors();
  void AddTogether(RestSystem* rest) const;
  GraphStep Complete(const Eigen::VectorXd& rest, const Inside& inside) const;

  const Graph& graph_;
  const RobustLoss loss_;
  std::vector<std::vector<int>> together_;
  std::vector<std::vector<MotionResidual>> motions_;
  std::vector<ObservationResidual> observations_;
  std::vector<Stretch> stretches_;
  int first_calibration_ = 0;  // Rows of the rest: separators before, calibrations, modes after.
  int first_mode_ = 0;
  std::unique_ptr<RestSystem> rest_;
  double cost_ = 0.0;
  double expected_decrease_ = 0.0;
  Weighting weighting_ = &RobustLoss::Weight;  // Of the last linearization.
};

}  // namespace shiftmap
