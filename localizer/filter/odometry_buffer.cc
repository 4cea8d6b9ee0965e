// SPDX-License-Identifier: Apache-2.0
#include "localizer/filter/odometry_buffer.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace shiftmap {
namespace {

// So long a velocity holds at most. [s]
constexpr double kHold = 1.0;

// Kept before the first scan.
constexpr std::size_t kSamplesBeforeStart = 8192;

// Adds the noise of a motion that nothing measures. The unknown speed is constant: the way grows
// with the time, not with its root.
void AppendUnknown(double elapsed_s, double speed_mps, OdometryBuffer::Motion* motion) {
  const double unknown_s = std::exchange(motion->unknown_s, motion->unknown_s + elapsed_s);
  const double way_variance = speed_mps * speed_mps * elapsed_s * (2.0 * unknown_s + elapsed_s);
  motion->increment.cov.diagonal().array() += kUnknownTurn * kUnknownTurn * elapsed_s;
  motion->increment.cov.diagonal().head<2>().array() += way_variance;
}

}  // namespace

void OdometryBuffer::Add(const OdometrySample& sample) {
  samples_.push_back(sample);
  fastest_mps_ = std::max(fastest_mps_.value_or(kLeastTopSpeed),
                          std::abs(calibration_.scale_v * sample.v_mps));
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
  Motion next;
  next.silent_s = pending_.silent_s;
  next.unknown_s = pending_.unknown_s;
  return std::exchange(pending_, next);
}

Duration OdometryBuffer::SilenceUntil(double sd_rad) {
  return FromSeconds(kHold + sd_rad * sd_rad / (kUnknownTurn * kUnknownTurn));
}

void OdometryBuffer::Restart() {
  samples_.clear();
  started_ = false;
  pending_ = Motion();
  fastest_mps_.reset();
}

void OdometryBuffer::AdvanceTo(Stamp end) {
  const Duration lag = FromSeconds(calibration_.lag_s);
  const Duration hold = FromSeconds(kHold);
  while (now_ < end) {
    while (samples_.size() > 1 && samples_[1].stamp + lag <= now_) samples_.pop_front();
    const bool held = !samples_.empty() && samples_[0].stamp + lag <= now_ &&
                      now_ < samples_[0].stamp + lag + hold;
    Stamp next = end;
    for (std::size_t i = 0; i < std::min<std::size_t>(2, samples_.size()); ++i) {
      if (samples_[i].stamp + lag > now_) next = std::min(next, samples_[i].stamp + lag);
    }
    if (held) next = std::min(next, samples_[0].stamp + lag + hold);
    const double elapsed_s = ToSeconds(next - now_);
    if (held) {
      const OdometrySample& sample = samples_[0];
      AppendMotion(
          sample.v_mps, sample.omega_radps, next - now_, calibration_, &pending_.increment);
      pending_.silent_s = 0.0;
      if (trusted_) {
        pending_.unknown_s = 0.0;
      } else {
        const double said_mps = std::abs(calibration_.scale_v * sample.v_mps);
        AppendUnknown(elapsed_s, std::max(said_mps, kLeastTopSpeed), &pending_);
      }
    } else {
      pending_.silent_s += elapsed_s;
      AppendUnknown(elapsed_s, fastest_mps_.value_or(kUnknownSpeed), &pending_);
    }
    pending_.elapsed_s += elapsed_s;
    now_ = next;
  }
}

}  // namespace shiftmap
