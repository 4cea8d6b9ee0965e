// SPDX-License-Identifier: Apache-2.0
//
// The static methods of the experiment, one position per landmark, and what all graph methods of it
// share: noise, motions, start.
#pragma once

#include <optional>
#include <vector>

#include "localizer/models/motion_model.h"
#include "mapper/graph/sensor_bias.h"
#include "mapper/mapper.h"
#include "tools/experiment/ijrr_utias_data.h"
#include "tools/experiment/ijrr_utias_score.h"

namespace shiftmap {

/// What a method takes odometry and sensor for.
struct UtiasNoise {
  OdometryCalibration odometry;
  SensorCalibration sensor;
  SensorBias bias = SensorBias::Zero();  ///< Taken off the observations before.

  /// If given, every 0.02 s of odometry has this standard deviation in x, y and yaw, times 0.02 s,
  /// instead of the calibration's random walk: Q of IJRR 8.2.1. [m/s, rad/s]
  std::optional<double> printed_process_sd;

  /// Residual at which the loss of an observation turns from square to logarithm.
  double loss_scale = 2.5;
};

/// As a build of the run by itself, without any map, estimates them. The odometry's noise is that
/// of its map, which holds over seconds; from one key frame to the next it is less.
UtiasNoise CalibratedNoise(const MapperResult& without_map);

/// As IJRR 8.2 prints them: 0.2 m, 0.11 rad, Q = dt² 0.01² I (0.03² for data set 2), odometry as it
/// is, least squares.
UtiasNoise PrintedNoise(int dataset);

/// Odometry between the key frames.
IndexedVector<FrameIndex, MotionIncrement> UtiasMotions(const UtiasCase& data,
                                                        const UtiasNoise& noise);

/// Sightings without the systematic errors of the sensor.
IndexedVector<SightingIndex, Observation> UtiasObservations(const UtiasCase& data,
                                                            const UtiasNoise& noise);

/// Key-frame poses to start from: EKF-SLAM, its landmarks laid over the places of the map by least
/// squares.
std::vector<Se2> StartPoses(const UtiasCase& data,
                            const UtiasNoise& noise,
                            const LandmarkPlaces& map);

enum class StaticLoss {
  kSquare,  ///< NOHYP of IJRR 8.2.3.
  kCauchy,  ///< On each landmark's distance from the map: landmarks may have moved.
};

/// One position per landmark with the map as prior, all in one graph.
/// @param prior_sd_m  Of each coordinate in the map.
UtiasEstimate SolveStatic(const UtiasCase& data,
                          const UtiasNoise& noise,
                          const LandmarkPlaces& map,
                          double prior_sd_m,
                          StaticLoss loss);

}  // namespace shiftmap
