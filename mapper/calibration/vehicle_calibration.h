// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "mapper/graph/graph_posterior.h"
#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"
#include "mapstore/map/estimate.h"
#include "mapstore/map/vehicle_calibration.h"

namespace shiftmap {

/// The systematic errors of a vehicle, order (log scale_v, log scale_omega, lag [s], bearing offset
/// [rad], range curvature [1/rad²]), all that localizers take off: posterior N(mean, cov) of the
/// prior N(prior_mean, diag(prior_sd²)) and its runs.
struct SystematicErrors {
  using Vector = Eigen::Matrix<double, 5, 1>;
  using Matrix = Eigen::Matrix<double, 5, 5>;

  Vector mean = Vector::Zero();
  Matrix cov = Matrix::Identity();
  Vector prior_mean = Vector::Zero();
  Vector prior_sd = Vector::Ones();
};

/// What the runs of a build say of one vehicle.
struct VehicleEstimate {
  std::string vehicle;  ///< As the logs name it; empty if they do not.
  int runs = 0;

  Interval scale_v;      ///< True over measured speed. [-]
  Interval scale_omega;  ///< True over measured yaw rate. [-]
  Interval lag_s;        ///< The motion at time t is what odometry says of t - lag. [s]
  Interval noise_v;      ///< Random walk of the motion, from key frame to key frame. [m/√s]
  Interval noise_omega;  ///< [rad/√s]

  Interval range_scale;  ///< Measured over true, beside what the fleet has in common. [-]
  Interval bearing_offset_rad;
  Interval range_curvature_per_rad2;
  Interval sd_range_m;
  Interval sd_bearing_rad;
  Interval detection_probability;  ///< P_D0: of a landmark in the field of view.

  SystematicErrors systematic;

  /// As a map has it that knows of these runs alone. Its noise is that which a localizer needs: the
  /// larger of the above and of what errors grow to over seconds.
  VehicleCalibration calibration;
};

/// The calibration of each vehicle of a solved build, from all its runs:
///
/// - Systematic errors c are the same in all runs of a vehicle. The runs' joint posterior N(ĉ, C)
///   has the prior N(c₀, P₀) once a run; with E the runs of each vehicle and R_v how many it has,
///
///     Λ = Eᵀ C⁻¹ E - diag((R_v - 1) P₀⁻¹),   c = Λ⁻¹ (Eᵀ C⁻¹ ĉ - (R_v - 1) P₀⁻¹ c₀)
///
///   has it once a vehicle. Normal quantiles.
/// - Noise: variance factors v'v / r of n residuals with redundancy r, as the common noise; χ²
///   quantiles with r²/n degrees of freedom. They tell the scatter; that yaw takes up a part of the
///   bearings' noise leaves sd_bearing_rad about 4 % too large, which is outside.
/// - P_D0: of the landmarks in the field of view of a key frame, the share that is detected.
///   Scans without a landmark are no key frames, so that a key frame counts for a landmark only if
///   it sees another one. Wilson's interval (1927).
///
/// By name. Precondition: the options calibrate; every mode is observed or in the prior.
/// @param graph        That of the build.
/// @param posterior  Of the graph, linearized at its present values.
std::vector<VehicleEstimate> CalibrateVehicles(const MapperOptions& options,
                                               const Graph& graph,
                                               const GraphPosterior& posterior,
                                               const BuildState& build);

}  // namespace shiftmap
