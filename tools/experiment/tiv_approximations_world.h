// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "localizer/models/motion_model.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/run.h"
#include "proto/core/status.h"
#include "tools/experiment/dice.h"

namespace shiftmap {

/// Seconds between the scans of a simulated drive.
inline constexpr double kTivScanPeriod = 0.3;

/// Stamp of a scan of a drive; -1 for that of the start.
Stamp TivScanStamp(int scan);

/// What becomes of a landmark of the prior map.
enum class LandmarkFate {
  kStays,       ///< One mode, and it stands there.
  kKnownPlace,  ///< Two modes, and it stands at the one that was less likely.
  kNewPlace,    ///< One mode, and it stands elsewhere, T-IV V-B2.
  kThirdPlace,  ///< Two modes, and it stands at neither, T-IV VI-B.
};

/// A landmark as it is during a drive.
struct TivLandmark {
  LandmarkFate fate = LandmarkFate::kStays;
  int modes = 1;       ///< Of it in the prior map.
  int true_state = 1;  ///< One more than `modes` at a place that the map does not have.
  Eigen::Vector2d place = Eigen::Vector2d::Zero();  ///< Where it stands, map frame. [m]
};

/// A drive past landmarks some of which moved since the map was made, and its truth.
struct ApproximationsDrive {
  MapContent map;
  PoseWithCovariance start;
  std::vector<MotionIncrement> motions;  ///< Before each scan.
  std::vector<Scan> scans;               ///< Each signature at most once.
  std::vector<Se2> T_map_vehicle;        ///< By scan.
  std::vector<TivLandmark> landmarks;    ///< By group of the map.
};

/// The vehicle, its sensor and how far landmarks move.
struct ApproximationsDriveOptions {
  int scans = 100;
  double speed_mps = 1.0;

  /// Of x and of y at the start: so large that a leaf may take a moved landmark for its own error.
  double sd_start_m = 0.3;
  double sd_start_yaw_rad = 0.05;
  double sd_mode_m = 0.1;  ///< Of each coordinate of a mode in the prior map. [m]

  /// Per step of the vehicle: along x, y, and of its yaw. [m, m, rad]
  Eigen::Vector3d sd_motion = {0.02, 0.02, 0.005};

  double sd_position_m = 0.1;  ///< Of each coordinate of an observation, T-IV (29). [m]
  double max_range_m = 6.0;    ///< All around.
  double detection_probability = 0.8;
  double false_alarms_per_m2 = 3e-4;   ///< β_FA of each signature, if there are false alarms.
  double new_landmarks_per_m2 = 3e-4;  ///< β_NT, as the filter has it.
  double shift_min_m = 1.2;            ///< Between two places of a landmark, at least. [m]
  double shift_max_m = 3.0;            ///< From a landmark's first place, at most. [m]

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// The sensor and the odometry of all drives, as the filter has them.
Calibration TivCalibration(const ApproximationsDriveOptions& options);

/// Appends a landmark to the prior map: its modes at `places`, independent of all others.
/// @param absent_prior, second_prior  Probabilities of `absent` and of each mode but the first.
void AddTivLandmark(const ApproximationsDriveOptions& options,
                    const TivLandmark& landmark,
                    const std::vector<Eigen::Vector2d>& places,
                    double absent_prior,
                    double second_prior,
                    ApproximationsDrive* drive);

/// Drives with constant speed and yaw rate from the pose `T_map_vehicle`: appends motions, scans
/// and poses.
/// @param dice    Of slip, detections and noise.
/// @param alarms  Of false alarms; null: there are none.
void DriveTiv(const ApproximationsDriveOptions& options,
              Se2 T_map_vehicle,
              double yaw_rate_radps,
              ApproximationsDrive* drive,
              Dice* dice,
              Dice* alarms);

/// A drive past landmarks of all fates in random order, with the start drawn from its covariance.
/// With or without false alarms the rest of it is the same, to the bit.
ApproximationsDrive SimulateApproximationsDrive(const ApproximationsDriveOptions& options,
                                                std::uint64_t seed,
                                                bool false_alarms);

}  // namespace shiftmap
