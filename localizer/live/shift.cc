// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/shift.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "localizer/hypothesis/position_region.h"
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

// Of a vehicle that stands, for so long.
constexpr double kStandingMps = 0.01;
constexpr double kStandingRadps = 0.01;
constexpr double kStandingS = 0.5;

// Landmarks seen within it tell of the pose now.
constexpr double kPresentS = 1.0;

// Hypotheses lighter than this share of all move no region.
constexpr double kLeastWeight = 1e-6;

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
  ReportEvents(events);
  return OkStatus();
}

void Shift::LocalizeHeld(std::vector<Event>* events) {
  localizer_.FlushPaused();
  UpdatePose();
  ReportEvents(events);
}

void Shift::UpdatePose() {
  const std::int64_t scans = localizer_.Statistics().scans;
  const auto estimate = localizer_.Estimate();
  if (estimate && scans != corrected_scans_) predictor_.Correct(*estimate);
  corrected_scans_ = scans;
  predictor_.Trust(localizer_.odometry_trusted());
  pose_ = predictor_.At(now_);
  if (pose_ && !IsFinite(pose_->pose)) pose_.reset();
}

void Shift::TellOdometer(const OdometrySample& sample) {
  const bool stands =
      std::abs(sample.v_mps) < kStandingMps && std::abs(sample.omega_radps) < kStandingRadps;
  if (last_sample_) {
    const double elapsed_s = ToSeconds(sample.stamp - last_sample_->stamp);
    if (elapsed_s < kMaxSampleGapS) driven_m_ += std::abs(last_sample_->v_mps) * elapsed_s;
    if (elapsed_s >= kMaxSampleGapS) standing_since_.reset();
  }
  if (!stands) standing_since_.reset();
  if (stands && !standing_since_) standing_since_ = sample.stamp;
  last_sample_ = sample;
}

void Shift::ReportEvents(std::vector<Event>* events) {
  if (pose_) events->emplace_back(PoseEvent{now_, pose_->pose, localizer_.state()});
  if (localizer_.state() != told_state_) {
    told_state_ = localizer_.state();
    events->emplace_back(StateEvent{now_, told_state_});
  }
  const std::vector<Decision>& made = localizer_.new_decisions();
  events->insert(events->end(), made.begin(), made.end());
}

bool Shift::Stands() const {
  return localizer_.odometry_trusted() && standing_since_ &&
         ToSeconds(last_sample_->stamp - *standing_since_) >= kStandingS &&
         ToSeconds(now_ - last_sample_->stamp) < kMaxSampleGapS;
}

double Shift::Score() const {
  const PoseSupport ever = localizer_.Support();
  if (ever.agreeing + ever.failing == 0) return 0.0;
  // A pose that is wrong shows there at once; innovations are of landmarks that agree.
  const auto estimate = localizer_.Estimate();
  const PoseSupport now = localizer_.Support(estimate->stamp - FromSeconds(kPresentS));
  return std::min(estimate->quality, FailureTail(now));
}

double Shift::RadiusHolding(double probability) const {
  const auto estimate = localizer_.Estimate();
  const PoseWithCovariance& now = pose_->pose;
  const PoseWithCovariance& then = estimate->pose;
  const Se2 moved = then.T_map_vehicle.Inverse() * now.T_map_vehicle;
  const Eigen::Matrix3d adjoint = moved.InverseAdjoint();
  const Eigen::Matrix3d noise =
      now.cov_T_map_vehicle - adjoint * then.cov_T_map_vehicle * adjoint.transpose();
  std::vector<WeightedPosition> mixture;
  const auto& leaves = localizer_.hypotheses()->leaves();
  for (const Leaf* leaf : leaves.all()) {
    const double weight = std::exp(leaf->log_weight - leaves.front().log_weight);
    if (weight < kLeastWeight) continue;
    const PoseWithCovariance pose = leaf->filter.Pose();
    const Se2 T = pose.T_map_vehicle * moved;
    const Eigen::Matrix3d cov = adjoint * pose.cov_T_map_vehicle * adjoint.transpose() + noise;
    const Eigen::Matrix2d R = Eigen::Rotation2Dd(T.yaw()).toRotationMatrix();
    mixture.push_back({weight, T.translation(), R * cov.topLeftCorner<2, 2>() * R.transpose()});
  }
  return shiftmap::RadiusHolding(probability, mixture, now.T_map_vehicle.translation());
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
