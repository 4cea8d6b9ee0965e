// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>

#include "mapper/graph/graph.h"
#include "mapper/graph/graph_segments.h"
#include "mapper/graph/residuals.h"
#include "mapper/graph/robust_loss.h"
#include "mapper/graph/segment.h"

namespace shiftmap {

/// What the square of an observation's residual is multiplied by in the matrix of the normal
/// equations (robust_loss.h). The gradient is the same for all.
enum class LossWeighting {
  kWeights,        ///< Iteratively reweighted least squares: a majorant of the loss.
  kStepCurvature,  ///< For steps near a minimum: weights leave a fifth of the way and more.
  kCurvature,      ///< For the Gaussian around a minimum.
};

/// The residuals of a graph, linearized at its values, segment by segment.
class SegmentLinearizer {
 public:
  /// @param graph  Must outlive this; its values may change, its shape may not.
  explicit SegmentLinearizer(const Graph& graph);

  /// Adds a segment's normal equations up. Returns half the sum of its losses.
  double Linearize(const GraphSegment& segment,
                   LossWeighting weighting,
                   SegmentSystem* system) const;

  /// The same sum alone.
  double Cost(const GraphSegment& segment) const;

  /// Calls add_motion(frame, linear) for each motion of a segment, and add_observation(i, root,
  /// linear) for its i-th observation, with the root of its weight.
  template <typename AddMotion, typename AddObservation>
  void Visit(const GraphSegment& segment,
             LossWeighting weighting,
             const AddMotion& add_motion,
             const AddObservation& add_observation) const {
    const Rotations R_map_vehicle = RotationsOf(segment);
    for (FrameIndex i = segment.first; i < segment.last; ++i) {
      add_motion(i, MotionAt(segment, R_map_vehicle, i));
    }
    VisitObservations(segment, weighting, R_map_vehicle, add_observation);
  }

  /// The same of its observations alone.
  template <typename AddObservation>
  void VisitObservations(const GraphSegment& segment,
                         LossWeighting weighting,
                         const AddObservation& add_observation) const {
    VisitObservations(segment, weighting, RotationsOf(segment), add_observation);
  }

 private:
  static double WeightOf(const RobustLoss& loss, LossWeighting weighting, double squared_residual);

  using Rotations = IndexedVector<FrameIndex, Eigen::Matrix2d>;  // From a segment's first frame on.

  template <typename AddObservation>
  void VisitObservations(const GraphSegment& segment,
                         LossWeighting weighting,
                         const Rotations& R_map_vehicle,
                         const AddObservation& add_observation) const {
    for (std::size_t i = 0; i < segment.observations.size(); ++i) {
      const ObservationResidual::Linear linear =
          ObservationAt(segment, R_map_vehicle, segment.observations[i]);
      add_observation(
          i, std::sqrt(WeightOf(losses_[segment.run], weighting, linear.r.squaredNorm())), linear);
    }
  }

  Rotations RotationsOf(const GraphSegment& segment) const;
  MotionResidual::Linear MotionAt(const GraphSegment& segment,
                                  const Rotations& R_map_vehicle,
                                  FrameIndex frame) const;
  ObservationResidual::Linear ObservationAt(const GraphSegment& segment,
                                            const Rotations& R_map_vehicle,
                                            ObservationIndex observation) const;

  const Graph& graph_;
  IndexedVector<RunIndex, RobustLoss> losses_;
  IndexedVector<RunIndex, IndexedVector<FrameIndex, MotionResidual>> motions_;
  IndexedVector<ObservationIndex, ObservationResidual> observations_;
};

}  // namespace shiftmap
