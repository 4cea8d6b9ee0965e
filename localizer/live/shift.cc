// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/shift.h"

#include <algorithm>
#include <cmath>

#include "localizer/initialization/start_pose.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap::live {
namespace {

// Between samples further apart the odometer is not told.
constexpr double kMaxSampleGapS = 1.0;

// Of a pose that the vehicle left unseen: what is added at least, and what is too much to start
// from.
constexpr double kUnseenSdM = 0.1;
constexpr double kUnseenSdRad = 0.05;
constexpr double kMaxUnseenSdM = 3.0;
constexpr double kMaxUnseenSdRad = 0.5;

bool IsFinite(const PoseWithCovariance& pose) {
  const Se2& T = pose.T_map_vehicle;
  return T.translation().allFinite() && std::isfinite(T.yaw()) &&
         pose.cov_T_map_vehicle.allFinite();
}

}  // namespace

LocalizerOptions Shift::OptionsOf(const ShiftHeader& header) {
  LocalizerOptions options;
  options.hypotheses.alpha = header.alpha;
  options.hypotheses.max_leaves = header.max_leaves;
  options.max_delay_s = header.max_delay_s;
  options.limits = header.limits;
  options.hypotheses.field_of_view.model = header.field_of_view;
  return options;
}

Shift::Shift(const MapSnapshot& map, const ShiftHeader& header)
    : header_(header),
      localizer_(map.ForVehicle(header.vehicle), OptionsOf(header)),
      predictor_(localizer_.snapshot().calibration().odometry) {}

Status Shift::Process(const RunEvent& item, std::vector<Event>* events) {
  SHIFTMAP_RETURN_IF_ERROR(localizer_.Process(item));
  now_ = std::max(now_, StampOf(item));
  // The prediction does not wait for what may still come late, and does without it.
  const auto* sample = std::get_if<OdometrySample>(&item);
  if (sample != nullptr && (!last_sample_ || sample->stamp >= last_sample_->stamp)) {
    predictor_.Add(*sample);
    TellOdometer(*sample);
  }
  UpdatePose();
  TellNews(events);
  return OkStatus();
}

void Shift::LocalizeHeld(std::vector<Event>* events) {
  localizer_.FlushPaused();
  UpdatePose();
  TellNews(events);
}

void Shift::UpdatePose() {
  const std::int64_t scans = localizer_.Statistics().scans;
  const auto estimate = localizer_.Estimate();
  if (estimate && scans != corrected_scans_) predictor_.Correct(*estimate);
  corrected_scans_ = scans;
  pose_ = predictor_.At(now_);
  if (pose_ && !IsFinite(pose_->pose)) pose_.reset();
}

void Shift::TellOdometer(const OdometrySample& sample) {
  if (last_sample_) {
    const double elapsed_s = ToSeconds(sample.stamp - last_sample_->stamp);
    if (elapsed_s < kMaxSampleGapS) driven_m_ += std::abs(last_sample_->v_mps) * elapsed_s;
  }
  last_sample_ = sample;
}

void Shift::TellNews(std::vector<Event>* events) {
  if (pose_) events->emplace_back(PoseEvent{now_, pose_->pose, localizer_.state()});
  if (localizer_.state() != told_state_) {
    told_state_ = localizer_.state();
    events->emplace_back(StateEvent{now_, told_state_});
  }
  const std::vector<Decision>& decisions = localizer_.decisions();
  // A restart takes decisions back.
  told_decisions_ = std::min(told_decisions_, decisions.size());
  for (; told_decisions_ < decisions.size(); ++told_decisions_) {
    events->emplace_back(decisions[told_decisions_]);
  }
}

ShiftReport Shift::Report(DropCounts dropped) const {
  Localizer ended = localizer_;
  ended.Finish();
  ShiftReport report = ended.Report();
  report.uuid = header_.uuid;
  report.vehicle = header_.vehicle;
  AddDropped(ended.Statistics(), &dropped);
  report.dropped = dropped.List();
  LeaveOutInvalid(&report);
  return report;
}

std::optional<SavedPose> Shift::PoseToSave() const {
  const LocalizerState state = localizer_.state();
  if (state == LocalizerState::kInitializing || state == LocalizerState::kLost) return std::nullopt;
  if (!pose_ || !ValidateStart(pose_->pose).ok()) return std::nullopt;
  SavedPose saved;
  saved.area = header_.area;
  saved.content_hash = header_.content_hash;
  saved.stamp = now_;
  saved.pose = pose_->pose;
  if (header_.odometer_m) saved.odometer_m = *header_.odometer_m + driven_m_;
  return saved;
}

std::optional<PoseWithCovariance> Shift::PoseAfter(double unseen_s) const {
  const auto saved = PoseToSave();
  if (!saved) return std::nullopt;
  const OdometrySample velocity = last_sample_.value_or(OdometrySample());
  const double sd_m = kUnseenSdM + std::abs(velocity.v_mps) * unseen_s;
  const double sd_rad = kUnseenSdRad + std::abs(velocity.omega_radps) * unseen_s;
  if (sd_m > kMaxUnseenSdM || sd_rad > kMaxUnseenSdRad) return std::nullopt;
  PoseWithCovariance pose = saved->pose;
  pose.cov_T_map_vehicle.diagonal() += Eigen::Vector3d(sd_m, sd_m, sd_rad).cwiseAbs2();
  return pose;
}

}  // namespace shiftmap::live
