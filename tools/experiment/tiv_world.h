// SPDX-License-Identifier: Apache-2.0
//
// The mine of T-IV IX: a prior map of its original version, and drives through either version.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "localizer/models/field_of_view.h"
#include "mapper/frontend/slam_state.h"
#include "mapper/tree/tree_slam.h"
#include "proto/core/status.h"
#include "tools/sim/mine_drive.h"

namespace shiftmap {

/// Where observations and noise come from.
enum class TivNoise {
  kPrinted,  ///< Interest points of two lidars; Q = 0.05 diag(0.05, 0.05, (5°)²), R = 0.25 I.
  kMatched,  ///< The same points; Q that of the simulated odometry, R that of the points.
  kIdeal,    ///< Landmarks along the drift seen with Gaussian noise; Q and R as simulated.
};

struct TivOptions {
  TivNoise noise = TivNoise::kPrinted;
  std::uint64_t seed = 1;
  double length_m = 100.0;  ///< Of the drift. [m]
  double scan_rate_hz = 5.0;
  bool euler = true;  ///< T-IV (28), else the exact arc.
  SlamState::Errors errors = SlamState::Errors::kInvariant;

  /// Of the pose that a drive starts with, standard deviations. [m], [rad]
  double start_sd_m = 0.05;
  double start_sd_rad = 0.01;
};

/// A drive as the filters get it.
struct TivDrive {
  /// From one scan to the next.
  struct Step {
    std::vector<OdometrySample> odometry;  ///< Samples that hold, each for T.
    Scan scan;
    LidarScan view;  ///< What both lidars cover, as one lidar at the vehicle's origin.
    Se2 truth;
  };
  std::vector<Step> steps;
  double odometry_period_s = 0.05;  ///< T.
};

/// The mine, its filters' noise, and a filter that has mapped its original version.
class TivWorld {
 public:
  /// Makes the mine and its map. Errors: those of MapOriginal().
  static StatusOr<TivWorld> Make(const TivOptions& options);

  /// TreeSlam after a drive through the original version from its true start. All of its
  /// covariance is kept, which a stored map does not have of landmarks without signature.
  /// Errors: those of the simulator; kInvalidArgument if the drive does not see a moved corner.
  StatusOr<TreeSlam> MapOriginal(std::uint64_t seed) const;

  /// The same mine, mapped otherwise.
  TivWorld WithMap(TreeSlam mapped) const;

  const TreeSlam& mapped() const { return *mapped_; }
  const TreeSlamOptions& tree() const { return tree_; }
  const Calibration& calibration() const { return calibration_; }
  const TivOptions& options() const { return options_; }
  const MineSite& site() const { return site_; }

  /// Q of T-IV (28), per step of T, order (x, y, yaw). [m², rad²]
  const Eigen::Matrix3d& Q() const { return Q_; }

  /// A day after day `day` - 1: in between a landmark stays where it is with probability 0.9, Π of
  /// T-IV IX-E.
  StatusOr<TivDrive> Simulate(PlanVersion version, std::uint64_t seed, int day) const;

  /// A start around the truth with its covariance.
  PoseWithCovariance Start(const Se2& truth, std::uint64_t seed) const;

  /// Where the version has a signed corner; nothing for another signature. [m]
  std::optional<Eigen::Vector2d> Corner(const Signature& signature, PlanVersion version) const;

 private:
  TivWorld() = default;

  TivOptions options_;
  MineSite site_;
  MineDriveOptions drive_;
  Calibration calibration_;
  TreeSlamOptions tree_;
  Eigen::Matrix3d Q_ = Eigen::Matrix3d::Zero();
  std::optional<TreeSlam> mapped_;
};

/// Predicts a TreeSlam to a step, and corrects it by its scan.
void Filter(const TivWorld& world,
            const TivDrive& drive,
            const TivDrive::Step& step,
            TreeSlam* slam);

/// A run of a TreeSlam: all of a drive.
void Filter(const TivWorld& world,
            const TivDrive& drive,
            const PoseWithCovariance& start,
            TreeSlam* slam);

/// Predicts a SlamState to a step.
void Predict(const TivWorld& world,
             const TivDrive& drive,
             const TivDrive::Step& step,
             SlamState* state);

}  // namespace shiftmap
