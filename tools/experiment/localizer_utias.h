// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/map/calibration.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/run.h"
#include "mapstore/run/trajectory.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Real robots among landmarks that stand at one of several surveyed layouts, the wrong one
/// believed in.
///
/// Data sets 1, 2, 3 and 6 of UTIAS MRCLAM have the same landmarks at four layouts. Taken as one
/// frame, each landmark has a mode per layout, and a recorded run of one data set tells which one
/// holds.
struct LayoutOptions {
  double stale_probability =
      0.9;  ///< Of the layout that does not hold; the rest shares what is left.
  double sd_start_m = 1.0;
  double sd_start_rad = 0.3;
  double sd_survey_m = 0.03;      ///< Of the surveyed places. [m]
  double same_place_m = 0.1;      ///< Layouts closer to each other share a mode. [m]
  double settled_after_s = 60.0;  ///< Poses count from here on. [s]
  double alpha = 1e-4;
};

/// A data set, and the robots whose files are at hand: others were not recorded whole.
struct UtiasRobots {
  int dataset = 0;
  std::array<int, 3> robots = {};
};

inline constexpr std::array<UtiasRobots, 4> kUtiasRobots = {
    {{1, {1, 2, 3}}, {2, {1, 2, 4}}, {3, {1, 2, 3}}, {6, {1, 2, 3}}}};

/// A drive and its truth, recorded or simulated.
struct TrueShift {
  int dataset = 0;
  int layout = 0;  ///< Index of the layout that holds.
  Run run;
  std::vector<StampedPose> truth;
};

using Layout = std::map<Signature, Eigen::Vector2d>;

struct UtiasShiftResult {
  double rmse_m = 0.0;         ///< Of the localizer with all layouts.
  double rmse_oracle_m = 0.0;  ///< Of the same one told which layout holds.
  double rmse_stale_m = 0.0;   ///< Of the same one with the stale layout alone.
  int decisions = 0;
  int wrong = 0;
  double median_observations = 0.0;  ///< Of a group up to its first decision.
};

/// The map of all layouts with `stale_probability` on one of them.
MapContent LayoutMap(const std::vector<Layout>& layouts,
                     int stale,
                     const Calibration& calibration,
                     const LayoutOptions& options);

/// Reads one robot's run and truth, from the first stamp that has both.
StatusOr<TrueShift> LoadUtiasShift(const std::string& data, int dataset, int robot, int layout);

/// What a fleet would know of its vehicles from mapping with another one: robot 1 of data sets 1
/// and 2, which share a frame. Errors: ReadUtias()'s and BuildMap()'s.
StatusOr<Calibration> MappedCalibration(const std::string& data);

/// Drives the three localizers along the run, from a start that is off by a draw from its
/// covariance.
UtiasShiftResult LocalizeUtias(const TrueShift& shift,
                               const std::vector<Layout>& layouts,
                               int stale,
                               const Calibration& calibration,
                               const LayoutOptions& options,
                               std::uint64_t seed);

}  // namespace shiftmap
