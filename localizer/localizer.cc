// SPDX-License-Identifier: Apache-2.0
#include "localizer/localizer.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>
#include <variant>

#include "localizer/models/observation_model.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// One signature seen further apart than this is at two places.
constexpr double kDuplicateSigmas = 5.0;

bool AtTwoPlaces(const Observation& a, const Observation& b, const SensorCalibration& sensor) {
  const Eigen::Matrix2d cov = PositionNoiseInVehicle(a, ObservationNoise(a, sensor)) +
                              PositionNoiseInVehicle(b, ObservationNoise(b, sensor));
  return SquaredMahalanobis(a.PositionInVehicle() - b.PositionInVehicle(), cov) >
         kDuplicateSigmas * kDuplicateSigmas;
}

}  // namespace

Localizer::Localizer(MapSnapshot snapshot, const LocalizerOptions& options)
    : snapshot_(std::move(snapshot)),
      options_(options),
      odometry_(snapshot_.calibration().odometry),
      next_start_(options.initial_pose) {
  const Status valid = options.Validate();
  SHIFTMAP_CHECK(valid.ok(), "{}", Message(valid));
}

Status Localizer::Process(const RunEvent& event) {
  SHIFTMAP_RETURN_IF_ERROR(ValidateEvent(event));
  const Stamp stamp = StampOf(event);
  if (begin_ && stamp < now_) {
    return InvalidArgument("event at {:.6f} s comes after one at {:.6f} s, expected time order",
                           ToSecondsSinceEpoch(stamp),
                           ToSecondsSinceEpoch(now_));
  }
  new_estimates_.clear();
  AccountTime(stamp);
  if (const auto* sample = std::get_if<OdometrySample>(&event)) {
    odometry_.Add(*sample);
  } else {
    ProcessScan(std::get<Scan>(event));
  }
  state_ = JudgeState();
  return OkStatus();
}

void Localizer::AccountTime(Stamp stamp) {
  if (begin_) {
    statistics_.seconds_in_state[static_cast<std::size_t>(state_)] += ToSeconds(stamp - now_);
  } else {
    begin_ = stamp;
  }
  now_ = stamp;
}

void Localizer::ProcessScan(const Scan& scan) {
  ++statistics_.scans;
  WindowScan step{UsableObservations(scan), odometry_.Take(scan.stamp)};
  if (next_start_) {
    window_.clear();
    window_.push_back(std::move(step));
    StartAt(*std::exchange(next_start_, std::nullopt), 0);
    return;
  }
  if (bank_) Step(step);
  if (bank_ && !health_.lost()) {
    window_.clear();
    return;
  }
  window_.push_back(std::move(step));
  const Duration kept = FromSeconds(options_.global_start.window_s);
  while (window_.front().scan.stamp < scan.stamp - kept) window_.pop_front();
  if (!window_.back().scan.observations.empty()) TryGlobalStart();
}

Scan Localizer::UsableObservations(const Scan& scan) {
  std::map<Signature, std::vector<const Observation*>> by_signature;
  for (const Observation& observation : scan.observations) {
    if (observation.signature.anonymous()) {
      ++statistics_.anonymous;
    } else {
      by_signature[observation.signature].push_back(&observation);
    }
  }
  Scan usable;
  usable.stamp = scan.stamp;
  for (const Observation& observation : scan.observations) {
    if (observation.signature.anonymous()) continue;
    const std::vector<const Observation*>& same = by_signature[observation.signature];
    if (same.front() != &observation) continue;
    const bool two_places = std::any_of(same.begin(), same.end(), [&](const Observation* other) {
      return AtTwoPlaces(observation, *other, snapshot_.calibration().sensor);
    });
    if (two_places) {
      ++statistics_.duplicate_signatures;
    } else {
      usable.observations.push_back(Corrected(observation, snapshot_.calibration().sensor));
    }
  }
  return usable;
}

void Localizer::Step(const WindowScan& step) {
  bank_->Predict(step.motion.increment, step.motion.elapsed_s);
  const BankEvents events = bank_->Correct(step.scan);
  scan_stamp_ = step.scan.stamp;

  for (const ObservationOutcome& outcome : events.outcomes) {
    health_.Add(outcome.group, outcome.gated);
    if (outcome.gated) {
      ++statistics_.updates;
      statistics_.nis_sum += outcome.nis;
    } else {
      ++statistics_.ungated;
    }
  }
  for (std::size_t i = 0; i < events.decisions.size(); ++i) {
    if (!events.surprising[i]) continue;
    const bool absent = events.decisions[i].mode == kAbsent;
    (absent ? unknown_change_ : mode_changed_) = step.scan.stamp;
  }
  evidence_.insert(evidence_.end(), events.evidence.begin(), events.evidence.end());
  decisions_.insert(decisions_.end(), events.decisions.begin(), events.decisions.end());
  CollectSightings(step.scan, events);
  // A restart replays scans that have had their estimate.
  if (!newest_estimate_ || step.scan.stamp > *newest_estimate_) {
    newest_estimate_ = step.scan.stamp;
    new_estimates_.push_back({step.scan.stamp, bank_->best().filter.Pose()});
  }
}

void Localizer::CollectSightings(const Scan& scan, const BankEvents& events) {
  if (health_.lost()) return;
  const PoseWithCovariance pose = bank_->best().filter.Pose();
  const auto collect = [&](const Observation& observation) {
    const Eigen::Vector2d q = observation.PositionInVehicle();
    Eigen::Matrix<double, 2, 3> dq_dxi;
    dq_dxi << 1.0, 0.0, -q.y(), 0.0, 1.0, q.x();
    const Eigen::Matrix2d R = pose.T_map_vehicle.Rotation();
    const Eigen::Matrix2d cov_vehicle =
        PositionNoiseInVehicle(observation,
                               ObservationNoise(observation, snapshot_.calibration().sensor)) +
        dq_dxi * pose.cov_T_map_vehicle * dq_dxi.transpose();
    return sightings_.Add(observation.signature,
                          LandmarkPosition(observation, pose.T_map_vehicle),
                          Symmetrized(R * cov_vehicle * R.transpose()),
                          pose.T_map_vehicle.translation(),
                          scan.stamp);
  };
  for (const Observation& observation : scan.observations) {
    if (snapshot_.GroupIndex(observation.signature) >= 0) continue;
    ++statistics_.unknown_signatures;
    collect(observation);
  }
  for (const ObservationOutcome& outcome : events.outcomes) {
    if (outcome.gated_any) continue;
    if (collect(scan.observations[outcome.index]) >= options_.min_sightings) {
      unknown_change_ = scan.stamp;
    }
  }
}

void Localizer::TryGlobalStart() {
  // Dead reckoning may have drifted too far for a long window: then a shorter one decides.
  for (std::size_t length = window_.size(); length > 0; length /= 2) {
    const std::size_t first = window_.size() - length;
    const std::vector<WindowScan> recent(window_.begin() + static_cast<std::ptrdiff_t>(first),
                                         window_.end());
    const auto start = FindGlobalStart(recent, snapshot_, options_.global_start);
    if (!start) continue;
    StartAt(start->pose, first);
    return;
  }
}

void Localizer::StartAt(const PoseWithCovariance& pose, std::size_t first) {
  const Stamp stamp = window_[first].scan.stamp;
  if (bank_) {
    bank_->Restart(pose, stamp);
    ForgetSince(stamp);
  } else {
    bank_.emplace(snapshot_, options_.hypotheses, pose, stamp);
  }
  ++statistics_.starts;
  health_.Reset();
  const std::deque<WindowScan> replayed = std::exchange(window_, {});
  for (std::size_t i = first; i < replayed.size(); ++i) {
    WindowScan step = replayed[i];
    if (i == first) step.motion = {};
    Step(step);
  }
}

void Localizer::ForgetSince(Stamp stamp) {
  std::erase_if(evidence_, [&](const VisitEvidence& evidence) { return evidence.end >= stamp; });
  std::erase_if(decisions_, [&](const Decision& decision) { return decision.stamp >= stamp; });
}

void Localizer::Initialize(const PoseWithCovariance& pose) { next_start_ = pose; }

std::optional<PoseEstimate> Localizer::Estimate() const {
  if (!bank_) return std::nullopt;
  return PoseEstimate{scan_stamp_, bank_->best().filter.Pose()};
}

LocalizerStatistics Localizer::Statistics() const {
  LocalizerStatistics statistics = statistics_;
  if (bank_) {
    statistics.leaves_max = bank_->leaves_max();
    statistics.dropped_mass_max = bank_->dropped_mass_max();
  }
  return statistics;
}

Eigen::VectorXd Localizer::Probabilities(int group) const {
  if (bank_) return bank_->Probabilities(group);
  return snapshot_.groups()[static_cast<std::size_t>(group)].probabilities;
}

LocalizerState Localizer::JudgeState() const {
  if (!bank_) return LocalizerState::kInitializing;
  if (health_.lost()) return LocalizerState::kLost;
  const Duration hold = FromSeconds(options_.state_hold_s);
  const auto recent = [&](const std::optional<Stamp>& cause) {
    return cause && now_ - *cause <= hold;
  };
  if (recent(unknown_change_)) return LocalizerState::kUnknownChange;
  if (recent(mode_changed_)) return LocalizerState::kModeChanged;
  return LocalizerState::kTracking;
}

void Localizer::Finish() {
  if (!bank_) return;
  std::vector<VisitEvidence> last = bank_->EndVisits();
  evidence_.insert(evidence_.end(), last.begin(), last.end());
}

ShiftReport Localizer::Report() const {
  ShiftReport report;
  report.area = snapshot_.area();
  report.version = snapshot_.version();
  report.content_hash = snapshot_.content_hash();
  report.begin = begin_.value_or(Stamp());
  report.end = now_;
  report.evidence = evidence_;
  report.decisions = decisions_;
  report.sightings = sightings_.Sightings();
  return report;
}

}  // namespace shiftmap
