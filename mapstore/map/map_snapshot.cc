// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/map_snapshot.h"

#include <cmath>
#include <utility>

#include "mapstore/core/magnitude.h"
#include "mapstore/core/stamp_check.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

Status ValidateMode(const Mode& mode, const std::string& owner) {
  if (mode.number.value() < 1) {
    return InvalidArgument("{}: mode number {}, expected 1 or more", owner, mode.number.value());
  }
  if (!mode.p_map_landmark.allFinite() ||
      mode.p_map_landmark.cwiseAbs().maxCoeff() > kMaxMagnitude) {
    return InvalidArgument("{}: mode {}: position ({}, {}), expected finite numbers up to {}",
                           owner,
                           mode.number.value(),
                           mode.p_map_landmark.x(),
                           mode.p_map_landmark.y(),
                           kMaxMagnitude);
  }
  if (!IsSymmetricPositiveDefinite(mode.cov_p_map_landmark) ||
      mode.cov_p_map_landmark.maxCoeff() > kMaxVariance) {
    return InvalidArgument(
        "{}: mode {}: covariance is not symmetric positive definite, or above {}",
        owner,
        mode.number.value(),
        kMaxVariance);
  }
  return ValidateStamp(mode.last_seen);
}

Status ValidateMerged(const LandmarkGroup& group, const std::string& owner) {
  const MergedMode* previous = nullptr;
  for (const MergedMode& merged : group.merged) {
    if (merged.number.value() < 1 || (previous != nullptr && !(previous->number < merged.number))) {
      return InvalidArgument("{}: merged modes do not ascend from 1", owner);
    }
    if (group.StateOf(merged.number) >= 0 || group.StateOf(merged.into) < 0) {
      return InvalidArgument("{}: mode {} cannot be part of mode {}",
                             owner,
                             merged.number.value(),
                             merged.into.value());
    }
    previous = &merged;
  }
  return OkStatus();
}

Status ValidateGroup(const LandmarkGroup& group) {
  const std::string owner = fmt::format("group '{}'", group.signature.text());
  if (group.signature.anonymous()) return InvalidArgument("a group has an empty signature");
  if (group.modes.empty()) return InvalidArgument("{}: no modes", owner);
  for (std::size_t i = 0; i < group.modes.size(); ++i) {
    SHIFTMAP_RETURN_IF_ERROR(ValidateMode(group.modes[i], owner));
    if (i > 0 && !(group.modes[i - 1].number < group.modes[i].number)) {
      return InvalidArgument("{}: mode numbers do not ascend", owner);
    }
  }
  const auto states = static_cast<Eigen::Index>(group.modes.size()) + 1;
  if (group.chain.states() != states) {
    return InvalidArgument(
        "{}: chain has {} states, expected {}", owner, group.chain.states(), states);
  }
  SHIFTMAP_RETURN_IF_ERROR(ValidateMerged(group, owner));
  if (!(group.chain.leave_rate_per_s() <= kMaxMagnitude)) {
    return InvalidArgument("{}: leave rate {} per second, expected at most {}",
                           owner,
                           group.chain.leave_rate_per_s(),
                           kMaxMagnitude);
  }
  if (const ChainRhythm* const rhythm = group.chain.rhythm()) {
    for (const Eigen::MatrixXd& rates : rhythm->rate_matrices()) {
      if (rates.cwiseAbs().maxCoeff() <= kMaxMagnitude) continue;
      return InvalidArgument(
          "{}: a rate of its rhythm is above {} per second", owner, kMaxMagnitude);
    }
  }
  if (group.probabilities.size() != states) {
    return InvalidArgument(
        "{}: {} probabilities, expected {}", owner, group.probabilities.size(), states);
  }
  if (!group.probabilities.allFinite() || group.probabilities.minCoeff() < 0.0 ||
      std::abs(group.probabilities.sum() - 1.0) > 1e-9) {
    return InvalidArgument("{}: probabilities are not a distribution", owner);
  }
  return OkStatus();
}

Status ValidateCovariance(const MapContent& content) {
  int index = 0;
  for (const LandmarkGroup& group : content.groups) {
    for (const Mode& mode : group.modes) {
      if (index >= content.covariance.size() ||
          content.covariance.Block(index, index) != mode.cov_p_map_landmark) {
        return InvalidArgument("group '{}': mode {}: joint covariance disagrees with the marginal",
                               group.signature.text(),
                               mode.number.value());
      }
      ++index;
    }
  }
  if (index != content.covariance.size()) {
    return InvalidArgument(
        "joint covariance of {} modes, expected {}", content.covariance.size(), index);
  }
  for (const JointCovariance::CrossBlock& block : content.covariance.cross_blocks()) {
    if (!block.value.allFinite() || block.value.cwiseAbs().maxCoeff() > kMaxVariance) {
      return InvalidArgument("joint covariance block ({}, {}) is not finite, or above {}",
                             block.row,
                             block.column,
                             kMaxVariance);
    }
  }
  return OkStatus();
}

Status ValidateVehicles(const std::vector<VehicleCalibration>& vehicles) {
  for (std::size_t i = 0; i < vehicles.size(); ++i) {
    SHIFTMAP_RETURN_IF_ERROR(ValidateVehicleCalibration(vehicles[i]));
    if (i > 0 && vehicles[i - 1].vehicle >= vehicles[i].vehicle) {
      return InvalidArgument("vehicle '{}': names do not ascend", vehicles[i].vehicle);
    }
  }
  return OkStatus();
}

}  // namespace

Status ValidateCalibration(const Calibration& calibration) {
  const auto positive = [](double value) {
    return value >= kMinMagnitude && value <= kMaxMagnitude;
  };
  const auto probability = [](double value) { return value > 0.0 && value < 1.0; };
  const OdometryCalibration& odometry = calibration.odometry;
  const SensorCalibration& sensor = calibration.sensor;
  if (!positive(odometry.scale_v) || !positive(odometry.scale_omega) ||
      !(std::abs(odometry.lag_s) <= kMaxLagS) || !positive(odometry.sd_log_scale) ||
      !positive(odometry.noise_v) || !positive(odometry.noise_omega)) {
    return InvalidArgument("odometry calibration out of range");
  }
  if (!positive(sensor.sd_range_m) || !positive(sensor.sd_bearing_rad) ||
      !positive(sensor.sd_position_m) ||
      !(std::abs(sensor.range_curvature_per_rad2) <= kMaxMagnitude) ||
      !(sensor.mean_squared_bearing_rad2 >= 0.0) ||
      !(sensor.mean_squared_bearing_rad2 <= kMaxMagnitude) || !positive(sensor.max_range_m) ||
      !positive(sensor.max_bearing_rad) || !probability(sensor.detection_probability) ||
      !probability(sensor.occluded_visit_probability) || !positive(sensor.clutter_density_per_m2) ||
      !positive(sensor.new_landmark_density_per_m2)) {
    return InvalidArgument("sensor calibration out of range");
  }
  if (sensor.bearing_offset_rad != 0.0) {
    return InvalidArgument("bearing offset {} of a fleet, expected 0", sensor.bearing_offset_rad);
  }
  return OkStatus();
}

Status ValidateMapContent(const MapContent& content) {
  for (std::size_t i = 0; i < content.groups.size(); ++i) {
    SHIFTMAP_RETURN_IF_ERROR(ValidateGroup(content.groups[i]));
    if (i > 0 && !(content.groups[i - 1].signature < content.groups[i].signature)) {
      return InvalidArgument("group '{}': signatures do not ascend",
                             content.groups[i].signature.text());
    }
  }
  SHIFTMAP_RETURN_IF_ERROR(ValidateCovariance(content));
  for (const Mode& landmark : content.anonymous_landmarks) {
    SHIFTMAP_RETURN_IF_ERROR(ValidateMode(landmark, "anonymous landmark"));
  }
  SHIFTMAP_RETURN_IF_ERROR(ValidateVehicles(content.vehicles));
  SHIFTMAP_RETURN_IF_ERROR(ValidateStamp(content.stamp));
  return ValidateCalibration(content.calibration);
}

MapSnapshot::MapSnapshot(std::string area,
                         VersionNumber version,
                         std::string content_hash,
                         MapContent content,
                         LedgerPosition ledger_position,
                         std::map<Signature, Signature> aliases)
    : area_(std::move(area)),
      version_(version),
      content_hash_(std::move(content_hash)),
      content_(std::make_shared<const MapContent>(std::move(content))),
      ledger_position_(ledger_position),
      calibration_(content_->calibration),
      aliases_(std::move(aliases)) {
  const Status valid = ValidateMapContent(*content_);
  SHIFTMAP_CHECK(valid.ok(), "{}", Message(valid));
  int mode_index = 0;
  for (std::size_t i = 0; i < groups().size(); ++i) {
    index_.emplace(groups()[i].signature, static_cast<int>(i));
    first_mode_.push_back(mode_index);
    mode_index += static_cast<int>(groups()[i].modes.size());
  }
  for (const auto& [name, now] : aliases_) {
    const auto group = index_.find(now);
    if (group != index_.end()) index_.emplace(name, group->second);
  }
}

MapSnapshot MapSnapshot::ForVehicle(const std::string& vehicle) const {
  MapSnapshot map = *this;
  map.calibration_ = content_->calibration;
  map.calibrated_vehicle_.clear();
  for (const VehicleCalibration& known : vehicles()) {
    if (known.vehicle != vehicle) continue;
    map.calibration_ = CalibrationOf(known, content_->calibration);
    map.calibrated_vehicle_ = vehicle;
  }
  return map;
}

int MapSnapshot::GroupIndex(const Signature& signature) const {
  const auto found = index_.find(signature);
  return found == index_.end() ? -1 : found->second;
}

}  // namespace shiftmap
