// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/pose_predictor.h"

namespace shiftmap::live {

void PosePredictor::Add(const OdometrySample& sample) {
  samples_.push_back(sample);
  if (samples_.size() <= kMaxSamples) return;
  if (!corrected_) {
    samples_.pop_front();
    return;
  }
  // What was driven so far is settled, and odometry goes on from there.
  corrected_ = At(sample.stamp);
  Trim();
}

void PosePredictor::Correct(const PoseEstimate& estimate) {
  corrected_ = estimate;
  Trim();
}

void PosePredictor::Trim() {
  const Stamp needed = corrected_->stamp - FromSeconds(calibration_.lag_s);
  while (samples_.size() > 1 && samples_[1].stamp <= needed) samples_.pop_front();
}

std::optional<PoseEstimate> PosePredictor::At(Stamp now) {
  if (!corrected_ || now <= corrected_->stamp) return corrected_;
  motion_.Restart();
  for (const OdometrySample& sample : samples_) motion_.Add(sample);
  motion_.Take(corrected_->stamp);
  const MotionIncrement increment = motion_.Take(now).increment;
  PoseEstimate moved;
  moved.stamp = now;
  moved.pose = Moved(corrected_->pose, increment);
  return moved;
}

}  // namespace shiftmap::live
