// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/check/lag_check.h"
#include "tools/convert/check/pair_motion.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace shiftmap {
namespace {

constexpr double kStepS = 0.1;
constexpr double kMinPairS = 1.0;
constexpr double kMaxPairS = 3.0;
constexpr double kMaxGapS = 1.0;  // Odometry says nothing of a longer one.

// What a pair must move, by sighting and odometry together, to be above the noise.
constexpr double kMinMotionM = 0.5;

constexpr std::int64_t kMinPairs = 50;
constexpr std::int64_t kMaxPairs = 20'000;
constexpr std::size_t kMaxAnchors = 10'000;
constexpr std::size_t kMaxPending = 100'000;
constexpr double kMinErrors = 5.0;  // Standard errors of the gain,
constexpr double kMinGain = 0.005;  // and its mean.

// A build estimates the lag of a run about that of the fleet, with a standard deviation of 0.2 s.
constexpr double kNoteS = 0.1;
constexpr double kWarningS = 0.4;

Se2 Arc(const OdometrySample& sample, Duration elapsed) {
  const double seconds = ToSeconds(elapsed);
  return Se2::Exp({sample.v_mps * seconds, 0.0, sample.omega_radps * seconds});
}

}  // namespace

void LagCheck::Add(const OdometrySample& sample) {
  Se2 T_begin_vehicle;
  if (!samples_.empty()) {
    const Sample& last = samples_.back();
    const Duration elapsed = sample.stamp - last.odometry.stamp;
    if (elapsed < Duration(0)) return;
    if (ToSeconds(elapsed) > kMaxGapS) {
      samples_.clear();
      anchors_.clear();
      pending_.clear();
    } else {
      T_begin_vehicle = last.T_begin_vehicle * Arc(last.odometry, elapsed);
    }
  }
  samples_.push_back({sample, T_begin_vehicle});
  ScoreDue(sample.stamp);
  const Duration kept = FromSeconds(2.0 * kSteps * kStepS + kMaxPairS + kMaxGapS);
  while (samples_.front().odometry.stamp + kept < sample.stamp) samples_.pop_front();
}

void LagCheck::Add(const Scan& scan) {
  if (pairs_ >= kMaxPairs) return;
  for (const Observation* const observed : IdentifiedOnce(scan)) {
    const Observation& observation = *observed;
    const std::string& signature = observation.signature.text();
    const Sighting now{scan.stamp, observation.PositionInVehicle()};
    const auto [known, added] = anchors_.emplace(signature, now);
    if (added) {
      if (anchors_.size() > kMaxAnchors) anchors_.erase(known);
      continue;
    }
    const double seconds = ToSeconds(now.stamp - known->second.stamp);
    if (seconds >= 0.0 && seconds < kMinPairS) continue;
    if (seconds > 0.0 && seconds <= kMaxPairS && pending_.size() < kMaxPending) {
      pending_.push_back({known->second, now});
    }
    known->second = now;
  }
}

void LagCheck::ScoreDue(Stamp newest) {
  const Duration reach = FromSeconds(kSteps * kStepS);
  while (!pending_.empty() && pending_.front().second.stamp + reach <= newest) {
    Score(pending_.front());
    pending_.pop_front();
  }
}

std::optional<Se2> LagCheck::PoseAt(Stamp stamp) const {
  const auto next = std::upper_bound(
      samples_.begin(), samples_.end(), stamp, [](Stamp wanted, const Sample& sample) {
        return wanted < sample.odometry.stamp;
      });
  if (next == samples_.begin()) return std::nullopt;
  const Sample& sample = *std::prev(next);
  return sample.T_begin_vehicle * Arc(sample.odometry, stamp - sample.odometry.stamp);
}

void LagCheck::Score(const Pair& pair) {
  std::array<double, kLags> misfits{};
  const Eigen::Vector2d& p1 = pair.first.position;
  for (std::size_t i = 0; i < kLags; ++i) {
    const Duration lag = FromSeconds((static_cast<double>(i) - kSteps) * kStepS);
    const std::optional<Se2> T_begin_first = PoseAt(pair.first.stamp - lag);
    const std::optional<Se2> T_begin_second = PoseAt(pair.second.stamp - lag);
    if (!T_begin_first || !T_begin_second) return;
    const PairMotion motion{pair.second.position - p1,
                            T_begin_second->Inverse() * (*T_begin_first * p1) - p1};
    if (i == kSteps && motion.total() < kMinMotionM) return;
    misfits[i] = motion.misfit();
  }
  ++pairs_;
  for (std::size_t i = 0; i < kLags; ++i) {
    const double gain = misfits[kSteps] - misfits[i];
    misfit_[i] += misfits[i];
    squared_gain_[i] += gain * gain;
  }
}

std::optional<double> LagCheck::Lag() const {
  if (pairs_ < kMinPairs) return std::nullopt;
  const auto best = static_cast<std::size_t>(
      std::distance(misfit_.begin(), std::min_element(misfit_.begin(), misfit_.end())));
  const auto pairs = static_cast<double>(pairs_);
  const double gain = misfit_[kSteps] - misfit_[best];
  const double spread = squared_gain_[best] - gain * gain / pairs;
  const bool shown =
      gain > kMinErrors * std::sqrt(std::max(spread, 0.0)) && gain > kMinGain * pairs;
  if (!shown) return std::nullopt;
  double refined = 0.0;
  if (best > 0 && best + 1 < kLags) {
    const double left = misfit_[best - 1] - misfit_[best];
    const double right = misfit_[best + 1] - misfit_[best];
    if (left + right > 0.0) refined = 0.5 * (left - right) / (left + right);
  }
  return (static_cast<double>(best) - kSteps + refined) * kStepS;
}

void LagCheck::Report(Findings* findings) const {
  const std::optional<double> lag = Lag();
  if (!lag || std::abs(*lag) < kNoteS) return;
  const bool large = std::abs(*lag) >= kWarningS;
  findings->push_back(
      {large ? Severity::kWarning : Severity::kNote,
       "lag",
       "odometry against scans",
       fmt::format("scans are stamped {:.2f} s {} than the odometry of the same moment, by {} "
                   "pairs of sightings",
                   std::abs(*lag),
                   *lag > 0.0 ? "later" : "earlier",
                   pairs_),
       large ? "stamp both where the data is measured, by one clock"
             : "a build estimates it; stamp where the data is measured to have none"});
}

}  // namespace shiftmap
