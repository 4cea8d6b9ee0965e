// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/incremental/frame_chunk.h"

#include <utility>

namespace shiftmap {
namespace {

// Starts the normal equations of a chunk with what is carried to its first pose.
void AddCarried(const CarriedSystem& before, SegmentSystem* system) {
  const Eigen::Index shared = before.b.size() - kCorrectionColumn;
  system->A.front() += before.H.topLeftCorner<3, 3>();
  system->B.block(0, kCorrectionColumn, 3, shared) +=
      before.H.bottomLeftCorner(shared, 3).transpose();
  system->C.block(kCorrectionColumn, kCorrectionColumn, shared, shared) +=
      before.H.bottomRightCorner(shared, shared);
  system->b.head<3>() += before.b.head<3>();
  system->c.segment(kCorrectionColumn, shared) += before.b.tail(shared);
}

// The motion from pose i of a chunk to the next, which is behind the chunk if i is its last.
void AddMotion(const MotionResidual::Linear& motion, std::size_t i, SegmentSystem* system) {
  const auto row = static_cast<Eigen::Index>(3 * i);
  const bool last = i + 1 == system->A.size();
  const Eigen::Matrix<double, 3, 4>& J_c = motion.J_calibration;
  system->A[i] += motion.J_i.transpose() * motion.J_i;
  system->b.segment<3>(row) -= motion.J_i.transpose() * motion.r;
  system->B.block<3, 4>(row, kCorrectionColumn) += motion.J_i.transpose() * J_c;
  system->C.block<4, 4>(kCorrectionColumn, kCorrectionColumn) += J_c.transpose() * J_c;
  system->c.segment<4>(kCorrectionColumn) -= J_c.transpose() * motion.r;
  const Eigen::Matrix3d H_next = motion.J_j.transpose() * motion.J_j;
  const Eigen::Vector3d b_next = -motion.J_j.transpose() * motion.r;
  if (last) {
    system->B.block<3, 3>(row, kPoseColumn) += motion.J_i.transpose() * motion.J_j;
    system->C.block<3, 3>(kPoseColumn, kPoseColumn) += H_next;
    system->C.block<4, 3>(kCorrectionColumn, kPoseColumn) += J_c.transpose() * motion.J_j;
    system->c.segment<3>(kPoseColumn) += b_next;
  } else {
    system->E[i] += motion.J_i.transpose() * motion.J_j;
    system->A[i + 1] += H_next;
    system->B.block<3, 4>(row + 3, kCorrectionColumn) += motion.J_j.transpose() * J_c;
    system->b.segment<3>(row + 3) += b_next;
  }
}

// An observation from pose i of a chunk.
void AddObservation(const ObservationResidual::Linear& seen,
                    std::size_t i,
                    int mode,
                    SegmentSystem* system) {
  const auto row = static_cast<Eigen::Index>(3 * i);
  const Eigen::Index column = ModeColumn(mode);
  system->A[i] += seen.J_pose.transpose() * seen.J_pose;
  system->b.segment<3>(row) -= seen.J_pose.transpose() * seen.r;
  system->B.block<3, 3>(row, kBiasColumn) += seen.J_pose.transpose() * seen.J_bias;
  system->B.block<3, 2>(row, column) += seen.J_pose.transpose() * seen.J_landmark;
  system->C.block<3, 3>(kBiasColumn, kBiasColumn) += seen.J_bias.transpose() * seen.J_bias;
  system->C.block<2, 3>(column, kBiasColumn) += seen.J_landmark.transpose() * seen.J_bias;
  system->C.block<2, 2>(column, column) += seen.J_landmark.transpose() * seen.J_landmark;
  system->c.segment<3>(kBiasColumn) -= seen.J_bias.transpose() * seen.r;
  system->c.segment<2>(column) -= seen.J_landmark.transpose() * seen.r;
}

}  // namespace

bool FrameChunk::Eliminate(const Window& window, const CarriedSystem& before) {
  SegmentSystem system(end_ - first_,
                       static_cast<int>(ModeColumn(static_cast<int>(window.modes.size()))));
  AddCarried(before, &system);
  if (first_ == 0 && window.start) {
    const MotionResidual::Linear start = LinearizeStart(window);
    system.A.front() += start.J_j.transpose() * start.J_j;
    system.b.head<3>() -= start.J_j.transpose() * start.r;
  }
  for (int f = first_; f < end_; ++f) {
    const auto i = static_cast<std::size_t>(f - first_);
    const WindowFrame& frame = window.frames[static_cast<std::size_t>(f)];
    AddMotion(LinearizeMotion(window, static_cast<std::size_t>(f)), i, &system);
    for (const WindowObservation& observation : frame.observations) {
      if (observation.mode == kNoMode) continue;
      AddObservation(
          LinearizeObservation(window, frame, observation), i, observation.mode, &system);
    }
  }
  segment_ = SegmentFactor::Of(&system);
  if (!segment_) return false;
  carried_ = {std::move(system.C), std::move(system.c)};
  return true;
}

void FrameChunk::BackSubstitute(const Eigen::VectorXd& steps, Window* window) const {
  Eigen::VectorXd boundary = steps.head(carried_.b.size());
  boundary.segment<3>(kPoseColumn) = window->frames[static_cast<std::size_t>(end_)].step;
  const Eigen::VectorXd poses = segment_->Solve(boundary);
  for (int f = first_; f < end_; ++f) {
    WindowFrame& frame = window->frames[static_cast<std::size_t>(f)];
    frame.step = poses.segment<3>(3 * Eigen::Index{f - first_});
    frame.T_map_vehicle = frame.origin * Se2::Exp(frame.step);
  }
}

}  // namespace shiftmap
