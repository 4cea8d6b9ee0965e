// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "mapper/tree/tree_slam.h"
#include "tools/experiment/sample_mean.h"
#include "tools/experiment/tiv_approximations_world.h"

namespace shiftmap {

struct TivApproximationsOptions {
  int drives = 200;
  std::uint64_t seed = 1;  ///< Of the first drive; the others' follow.
  int threads = 1;         ///< Drives side by side; the result does not depend on it.
  ApproximationsDriveOptions drive;

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// One setting of the approximations. All arms get the same drives.
struct TivArm {
  std::string name;
  TreeSlamOptions options;
};

/// The printed settings that differ in effect: the first is what shiftmap-mapper builds with, then
/// each alternative by itself, then those that bear on one another.
std::vector<TivArm> TivArms();

/// What an arm made of one drive.
struct TivOutcome {
  // By scan, of the likeliest leaf.
  std::vector<double> squared_error_m2;  ///< Of its position.
  std::vector<double> nees;              ///< Of its pose; 3 if consistent.
  std::vector<double> leaves;

  int leaves_max = 0;
  std::vector<double> scans_to_right;  ///< Per landmark that moved and was decided right.
  int moved = 0;                       ///< Landmarks that do not stand at their likelier mode.
  int wrong_decisions = 0;
  int moved_right = 0;     ///< Those whose true mode is active at the end, the old ones kept.
  bool all_right = false;  ///< All landmarks are so.
  int spurious_modes = 0;  ///< Modes at the end beyond those of the map and the new places.
};

TivOutcome RunApproximationsDrive(const ApproximationsDrive& drive, const TreeSlamOptions& options);

/// How one arm does over all drives.
struct TivApproximationsRow {
  TivArm arm;
  bool false_alarms = false;

  SampleMean rmse_m;         ///< Of the position over scans and drives, by the delta method.
  SampleMean nees;           ///< Of the pose, mean over scans.
  SampleMean rmse_paired_m;  ///< Of a drive, less that of the first arm on the same drive.
  double leaves = 0.0;       ///< Mean over scans.
  int leaves_max = 0;
  SampleMean scans_to_right;     ///< From a landmark's first observation, over drives.
  double undecided_share = 0.0;  ///< Of the landmarks that moved: never decided right.
  SampleMean wrong_decisions;    ///< Per drive.
  SampleMean moved_right;        ///< Share of a drive's landmarks that moved.
  SampleMean drives_right;       ///< Share of drives.
  SampleMean spurious_modes;     ///< Per drive.

  // By scan, over drives.
  std::vector<SampleMean> rmse_over_time_m;
  std::vector<SampleMean> nees_over_time;
};

/// Rows by presence of false alarms, none first, then arm. Determinism: the same options give the
/// same rows. Errors: as Validate().
StatusOr<std::vector<TivApproximationsRow>> RunTivApproximations(
    const TivApproximationsOptions& options, const std::function<void(double done)>& progress);

}  // namespace shiftmap
