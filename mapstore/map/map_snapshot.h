// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/calibration.h"
#include "mapstore/map/joint_covariance.h"
#include "mapstore/map/landmark_group.h"
#include "mapstore/map/vehicle_calibration.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What a map version says: its content hash covers it, the probabilities only if they are stated.
struct MapContent {
  std::vector<LandmarkGroup> groups;  ///< By ascending signature, each once, none anonymous.

  /// Of all modes, in the order of `groups` and their `modes`; its diagonal equals the modes'
  /// marginals.
  JointCovariance covariance;

  std::vector<Mode> anonymous_landmarks;  ///< Landmarks without a signature; static.
  Calibration calibration;                ///< Of the fleet.

  /// The vehicles that are known by themselves, by ascending name, each once.
  std::vector<VehicleCalibration> vehicles;

  /// The time at which the groups' probabilities hold: the end of the newest run that built the
  /// map.
  Stamp stamp;
};

/// Errors: kInvalidArgument if a value is out of range.
Status ValidateCalibration(const Calibration& calibration);

/// Checks everything that readers rely on: order and uniqueness of groups and modes, sizes, finite
/// numbers, positive definite covariances, probabilities that sum to 1, calibration in range.
/// Errors: kInvalidArgument, naming the first group and mode that is wrong.
Status ValidateMapContent(const MapContent& content);

/// SHA-256 in hex over the canonical rows of `content`: the same for equal content, whatever the
/// order of insertion or the layout of the file it is stored in. Numbers enter bit by bit.
std::string ContentHash(const MapContent& content);

/// The same without the groups' probabilities: of content whose probabilities are derived.
std::string GeometryHash(const MapContent& content);

/// A version of an area's map as readers see it: immutable, in memory, without any I/O.
///
/// Threads: const-safe. Ownership: self-contained; copies share the content.
class MapSnapshot {
 public:
  /// @param content  Valid by ValidateMapContent.
  /// @param content_hash  Of the version as committed; the probabilities in `content` may be newer.
  /// @param ledger_position  The reports that the probabilities account for up to the stamp.
  /// @param aliases          As aliases() gives them.
  MapSnapshot(std::string area,
              VersionNumber version,
              std::string content_hash,
              MapContent content,
              LedgerPosition ledger_position = {},
              std::map<Signature, Signature> aliases = {});

  const std::string& area() const { return area_; }
  VersionNumber version() const { return version_; }
  const std::string& content_hash() const { return content_hash_; }

  const std::vector<LandmarkGroup>& groups() const { return content_->groups; }
  const std::vector<Mode>& anonymous_landmarks() const { return content_->anonymous_landmarks; }
  const JointCovariance& covariance() const { return content_->covariance; }
  const std::vector<VehicleCalibration>& vehicles() const { return content_->vehicles; }
  const MapContent& content() const { return *content_; }

  /// The calibration that a localizer uses: the fleet's, or by ForVehicle() a vehicle's own.
  const Calibration& calibration() const { return calibration_; }

  /// The vehicle whose own calibration() is; empty: it is the fleet's.
  const std::string& calibrated_vehicle() const { return calibrated_vehicle_; }

  /// The same map for a localizer on `vehicle`: with the vehicle's own calibration if the map has
  /// one, else with the fleet's.
  MapSnapshot ForVehicle(const std::string& vehicle) const;

  /// The time at which the probabilities hold.
  Stamp stamp() const { return content_->stamp; }

  /// What a version that is made from this map names in CommitOptions.
  LedgerPosition ledger_position() const { return ledger_position_; }

  /// Former names of landmarks that were renamed, each with the name in groups().
  const std::map<Signature, Signature>& aliases() const { return aliases_; }

  /// The index in groups() of a signature or of a former one, or -1; O(1).
  int GroupIndex(const Signature& signature) const;

  /// The row of a mode in covariance(): `state` counts from 1 as in LandmarkGroup.
  int ModeIndex(int group_index, int state) const {
    return first_mode_[static_cast<std::size_t>(group_index)] + state - 1;
  }

 private:
  std::string area_;
  VersionNumber version_;
  std::string content_hash_;
  std::shared_ptr<const MapContent> content_;
  LedgerPosition ledger_position_;
  Calibration calibration_;
  std::string calibrated_vehicle_;
  std::map<Signature, Signature> aliases_;
  std::unordered_map<Signature, int> index_;
  std::vector<int> first_mode_;
};

}  // namespace shiftmap
