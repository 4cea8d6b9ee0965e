// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/segment_linearizer.h"

#include <utility>

namespace shiftmap {
namespace {

// The normal equations of one residual of three variables a, b and c, worked out for all of them at
// once: J = (J_a, J_b, J_c, r), and the upper triangle of w Jᵀ J.
template <int kRows, int kA, int kB, int kC>
class FactorProducts {
 public:
  template <typename JacobianA, typename JacobianB, typename JacobianC, typename Residual>
  FactorProducts(const Residual& r,
                 const JacobianA& J_a,
                 const JacobianB& J_b,
                 const JacobianC& J_c,
                 double weight = 1.0) {
    if constexpr (kWidth > kEnd + 1) J_.template rightCols<1>().setZero();
    J_.template leftCols<kA>() = J_a;
    J_.template middleCols<kB>(kA) = J_b;
    J_.template middleCols<kC>(kA + kB) = J_c;
    J_.col(kEnd) = r;
    FillRows(weight, std::make_integer_sequence<int, kEnd>());
  }

  // Adds it up. Precondition: poses of the segment are given in their order and before columns of
  // the boundary; of these each is after those before it, but for a before a pose.
  void AddTo(const SegmentVariable& a,
             const SegmentVariable& b,
             const SegmentVariable& c,
             SegmentSystem* out) const {
    AddSelf<0, kA>(a, out);
    AddSelf<kA, kB>(b, out);
    AddSelf<kA + kB, kC>(c, out);
    AddPair<0, kA, kA, kB>(a, b, out);
    AddPair<0, kA, kA + kB, kC>(a, c, out);
    AddPair<kA, kB, kA + kB, kC>(b, c, out);
  }

 private:
  static constexpr int kEnd = kA + kB + kC;  // The column of the residual.
  static constexpr int kWidth = (kEnd + 2) / 2 * 2;

  template <int... kRow>
  void FillRows(double weight, std::integer_sequence<int, kRow...>) {
    (FillRow<kRow>(weight), ...);
  }

  template <int kRow>
  void FillRow(double weight) {
    constexpr int kFirst = kRow / 2 * 2;
    constexpr int kCount = kWidth - kFirst;
    auto row = H_.template block<1, kCount>(kRow, kFirst);
    if constexpr (kRows == 2) {
      row = weight * J_(0, kRow) * J_.template block<1, kCount>(0, kFirst) +
            weight * J_(1, kRow) * J_.template block<1, kCount>(1, kFirst);
    } else {
      static_assert(kRows == 3);
      row = weight * J_(0, kRow) * J_.template block<1, kCount>(0, kFirst) +
            weight * J_(1, kRow) * J_.template block<1, kCount>(1, kFirst) +
            weight * J_(2, kRow) * J_.template block<1, kCount>(2, kFirst);
    }
  }

  // A variable with itself, in the lower triangle, and its gradient.
  template <int kAt, int kSize>
  void AddSelf(const SegmentVariable& a, SegmentSystem* out) const {
    for (int i = 0; i < kSize; ++i) {
      const double gradient = H_(kAt + i, kEnd);
      if (a.pose >= 0) {
        out->b[3 * a.pose + i] -= gradient;
      } else {
        out->c[a.column + i] -= gradient;
      }
      for (int j = i; j < kSize; ++j) {
        const double value = H_(kAt + i, kAt + j);
        if (a.pose >= 0) {
          if constexpr (kSize == 3) out->A[static_cast<std::size_t>(a.pose)](j, i) += value;
        } else {
          out->C(a.column + j, a.column + i) += value;
        }
      }
    }
  }

  template <int kAtA, int kSizeA, int kAtB, int kSizeB>
  void AddPair(const SegmentVariable& a, const SegmentVariable& b, SegmentSystem* out) const {
    const auto product = H_.template block<kSizeA, kSizeB>(kAtA, kAtB);
    if (a.pose >= 0 && b.pose >= 0) {
      if constexpr (kSizeA == 3 && kSizeB == 3) {
        out->E[static_cast<std::size_t>(a.pose)] += product;
      }
    } else if (a.pose >= 0) {
      out->B.block<kSizeA, kSizeB>(3 * a.pose, b.column) += product;
    } else if (b.pose >= 0) {
      out->B.block<kSizeB, kSizeA>(3 * b.pose, a.column) += product.transpose();
    } else {
      out->C.block<kSizeB, kSizeA>(b.column, a.column) += product.transpose();
    }
  }

  Eigen::Matrix<double, kRows, kWidth, Eigen::RowMajor> J_;
  Eigen::Matrix<double, kEnd, kWidth, Eigen::RowMajor> H_;
};

}  // namespace

SegmentLinearizer::SegmentLinearizer(const Graph& graph) : graph_(graph), losses_(LossesOf(graph)) {
  for (const GraphRun& run : graph.runs) {
    auto& motions = motions_.emplace_back();
    motions.reserve(run.motions.size());
    for (const MotionIncrement& motion : run.motions) {
      motions.emplace_back(motion, run.variance_factor);
    }
  }
  observations_.reserve(graph.observations.size());
  for (const GraphObservation& item : graph.observations) observations_.emplace_back(item);
}

double SegmentLinearizer::WeightOf(const RobustLoss& loss,
                                   LossWeighting weighting,
                                   double squared_residual) {
  switch (weighting) {
    case LossWeighting::kWeights:
      return loss.Weight(squared_residual);
    case LossWeighting::kStepCurvature:
      return loss.StepCurvature(squared_residual);
    case LossWeighting::kCurvature:
      break;
  }
  return loss.Curvature(squared_residual);
}

SegmentLinearizer::Rotations SegmentLinearizer::RotationsOf(const GraphSegment& segment) const {
  const GraphRun& run = graph_.runs[segment.run];
  Rotations rotations;
  rotations.reserve(kSegmentPoses + 2);
  for (FrameIndex i = segment.first; i <= segment.last; ++i) {
    rotations.push_back(run.poses[i].Rotation());
  }
  return rotations;
}

// The motion from a frame of a segment to the next.
// @param R_map_vehicle  RotationsOf(segment), here and below.
MotionResidual::Linear SegmentLinearizer::MotionAt(const GraphSegment& segment,
                                                   const Rotations& R_map_vehicle,
                                                   FrameIndex frame) const {
  const GraphRun& run = graph_.runs[segment.run];
  return motions_[segment.run][frame].At(run.poses[frame],
                                         R_map_vehicle[FrameIndex(frame - segment.first)],
                                         run.poses[frame + 1],
                                         run.correction,
                                         run.sensor_bias[kLogRangeScale]);
}

// An observation of a segment.
ObservationResidual::Linear SegmentLinearizer::ObservationAt(const GraphSegment& segment,
                                                             const Rotations& R_map_vehicle,
                                                             ObservationIndex observation) const {
  const GraphObservation& item = graph_.observations[observation];
  const GraphRun& run = graph_.runs[segment.run];
  return observations_[observation].At(run.poses[item.frame],
                                       R_map_vehicle[FrameIndex(item.frame - segment.first)],
                                       graph_.modes[item.mode],
                                       run.sensor_bias);
}

double SegmentLinearizer::Linearize(const GraphSegment& segment,
                                    LossWeighting weighting,
                                    SegmentSystem* system) const {
  const RobustLoss& loss = losses_[segment.run];
  const Rotations R_map_vehicle = RotationsOf(segment);
  double cost = 0.0;
  for (FrameIndex i = segment.first; i < segment.last; ++i) {
    const MotionResidual::Linear linear = MotionAt(segment, R_map_vehicle, i);
    const FactorProducts<3, 3, 3, 4> products(
        linear.r, linear.J_i, linear.J_j, linear.J_calibration);
    products.AddTo(
        PoseVariable(segment, i), PoseVariable(segment, i + 1), {-1, kCorrectionColumn}, system);
    cost += 0.5 * linear.r.squaredNorm();
  }
  for (std::size_t k = 0; k < segment.observations.size(); ++k) {
    const ObservationIndex index = segment.observations[k];
    const ObservationResidual::Linear linear = ObservationAt(segment, R_map_vehicle, index);
    const double squared = linear.r.squaredNorm();
    cost += loss.HalfLoss(squared);
    // The slope is by the weight, whatever the matrix is by.
    const double weight = WeightOf(loss, weighting, squared);
    const FactorProducts<2, 3, 3, 2> products(
        Eigen::Vector2d(loss.Slope(squared) / weight * linear.r),
        linear.J_pose,
        linear.J_bias,
        linear.J_landmark,
        weight);
    const FrameIndex frame = graph_.observations[index].frame;
    products.AddTo(
        PoseVariable(segment, frame), {-1, kBiasColumn}, {-1, segment.mode_columns[k]}, system);
  }
  return cost;
}

double SegmentLinearizer::Cost(const GraphSegment& segment) const {
  const GraphRun& run = graph_.runs[segment.run];
  const RobustLoss& loss = losses_[segment.run];
  const Rotations R_map_vehicle = RotationsOf(segment);
  double cost = 0.0;
  for (FrameIndex i = segment.first; i < segment.last; ++i) {
    cost += 0.5 * motions_[segment.run][i]
                      .ResidualAt(run.poses[i],
                                  R_map_vehicle[FrameIndex(i - segment.first)],
                                  run.poses[i + 1],
                                  run.correction,
                                  run.sensor_bias[kLogRangeScale])
                      .squaredNorm();
  }
  for (const ObservationIndex index : segment.observations) {
    const GraphObservation& item = graph_.observations[index];
    cost += loss.HalfLoss(observations_[index]
                              .ResidualAt(run.poses[item.frame],
                                          R_map_vehicle[FrameIndex(item.frame - segment.first)],
                                          graph_.modes[item.mode],
                                          run.sensor_bias)
                              .squaredNorm());
  }
  return cost;
}

}  // namespace shiftmap
