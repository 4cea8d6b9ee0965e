// SPDX-License-Identifier: Apache-2.0
#include "localizer/filter/odometry_buffer.h"

#include <algorithm>
#include <chrono>
#include <utility>

namespace shiftmap {
namespace {

constexpr Duration kHold = std::chrono::seconds(1);

// Where odometry is silent: per √s, what a vehicle of unknown speed can do. [m/√s], [rad/√s]
constexpr double kUnknownMotion = 0.5;

// Kept before the first scan.
constexpr std::size_t kSamplesBeforeStart = 8192;

void AppendUnknownMotion(Duration elapsed, MotionIncrement* increment) {
  increment->cov.diagonal().array() += kUnknownMotion * kUnknownMotion * ToSeconds(elapsed);
}

}  // namespace

void OdometryBuffer::Add(const OdometrySample& sample) {
  samples_.push_back(sample);
  if (samples_.full() && started_) AdvanceTo(sample.stamp);
  if (!samples_.full()) return;
  const bool needed = samples_[1].stamp + FromSeconds(calibration_.lag_s) > sample.stamp;
  if (needed || (!started_ && samples_.size() < kSamplesBeforeStart)) {
    samples_.set_capacity(2 * samples_.capacity());
  } else {
    samples_.pop_front();
  }
}

OdometryBuffer::Motion OdometryBuffer::Take(Stamp end) {
  if (!started_) {
    started_ = true;
    now_ = end;
  }
  AdvanceTo(end);
  return std::exchange(pending_, Motion());
}

void OdometryBuffer::Restart() {
  samples_.clear();
  started_ = false;
  pending_ = Motion();
}

void OdometryBuffer::AdvanceTo(Stamp end) {
  const Duration lag = FromSeconds(calibration_.lag_s);
  while (now_ < end) {
    while (samples_.size() > 1 && samples_[1].stamp + lag <= now_) samples_.pop_front();
    const bool held = !samples_.empty() && samples_[0].stamp + lag <= now_ &&
                      now_ < samples_[0].stamp + lag + kHold;
    Stamp next = end;
    for (std::size_t i = 0; i < std::min<std::size_t>(2, samples_.size()); ++i) {
      if (samples_[i].stamp + lag > now_) next = std::min(next, samples_[i].stamp + lag);
    }
    if (held) {
      next = std::min(next, samples_[0].stamp + lag + kHold);
      AppendMotion(samples_[0].v_mps,
                   samples_[0].omega_radps,
                   next - now_,
                   calibration_,
                   &pending_.increment);
    } else {
      AppendUnknownMotion(next - now_, &pending_.increment);
    }
    pending_.elapsed_s += ToSeconds(next - now_);
    now_ = next;
  }
}

}  // namespace shiftmap
