// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "proto/core/status.h"
#include "tools/experiment/ijrr_utias_data.h"
#include "tools/experiment/ijrr_utias_score.h"

namespace shiftmap {

/// The experiment of IJRR 8.2 on recorded data: figures 8 to 11 and table 1.
struct IjrrUtiasOptions {
  std::string data;  ///< Holds MRCLAM_Dataset<N>.
  std::vector<int> datasets = {1, 2, 3};
  std::vector<int> robots = {1};

  /// As UtiasProtocol::start_s. What a data set has not of robots and starts is left out.
  std::vector<double> starts_s = {0.0};

  std::vector<double> deltas_m = {0.0, 0.1, 0.2, 0.3, 0.6, 1.0, 1.5, 2.1, 2.5};
  UtiasProtocol protocol;

  /// Names of IjrrUtiasMethods(); empty for all. Selectors run frame by frame as calibrated, with
  /// `-printed` as the paper prints odometry and noise, and with `-40s` in a window of 40 s.
  std::vector<std::string> methods;

  /// IJRR 8.2.4 instead of 8.2.2: change probability 0.1 and gate 0.8, many more modes.
  bool more_modes = false;

  /// Gate of the paper's selectors instead of the 0.95 of IJRR 8.2.2. In (0, 1).
  std::optional<double> gate_probability;

  MctsOptions mcts;

  /// Of a method with something random in it; the mean is taken over them. IJRR 8.2.3 has 12 of its
  /// NN and MCTS.
  int realizations = 1;
  int threads = 1;         ///< Realizations side by side; but for the times the rows are the same.
  std::uint64_t seed = 1;  ///< Of the first realization; each one has the next.

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// One method on one run with one displacement: the mean over its realizations.
struct IjrrUtiasRow {
  int dataset = 0;
  int robot = 0;
  double start_s = 0.0;
  double delta_m = 0.0;
  std::string method;
  int realizations = 1;             ///< One unless the method is random.
  double pose_rmse_m = 0.0;         ///< Not finite if the method failed in one of them.
  double pose_rmse_se_m = 0.0;      ///< Its standard error; not finite for one realization.
  double step_pose_rmse_m = 0.0;    ///< Of the poses when they came in; not finite for a batch.
  double landmark_rmse_m = 0.0;     ///< Not finite if the method failed in one of them.
  double landmark_rmse_se_m = 0.0;  ///< As that of the pose.
  double modes = 0.0;
  double created = 0.0;
  double full_optimizations = 0.0;

  /// The build waits: there is no estimate, but explanations.
  bool waits = false;

  /// Of a build that does not decide which landmarks were displaced, that of the truth.
  std::optional<double> truth_probability;

  double cpu_s = 0.0;      ///< Processor time of the thread; more trees than one have their own.
  int frames = 0;          ///< Key frames.
  UtiasEstimate estimate;  ///< The first realization's; empty if that failed.
};

/// A method as the experiment names it.
struct IjrrUtiasMethod {
  std::string name;
  std::string figure;  ///< Of the RMSE, that it is drawn in: "printed", "calibrated", or none.
  bool fine_deltas = false;  ///< Also at displacements that are not in the paper's series.
  bool slow = false;         ///< Left out in a quick run.
  bool random = false;       ///< Has realizations.
};

/// All methods, in the order of the rows.
std::vector<IjrrUtiasMethod> IjrrUtiasMethods();

struct IjrrUtiasResult {
  std::vector<UtiasCase> cases;    ///< By data set, then robot.
  std::vector<IjrrUtiasRow> rows;  ///< By case, displacement, method.
};

/// Determinism: the same options give the same rows but for the times. Errors: as Validate(); those
/// of reading the data, if a data set has none of the runs.
StatusOr<IjrrUtiasResult> RunIjrrUtias(
    const IjrrUtiasOptions& options,
    const std::function<void(const std::string& what, double done)>& progress);

}  // namespace shiftmap
