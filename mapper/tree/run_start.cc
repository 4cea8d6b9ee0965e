// SPDX-License-Identifier: Apache-2.0
#include "mapper/tree/run_start.h"

#include <Eigen/LU>
#include <cstddef>
#include <deque>
#include <vector>

#include "localizer/initialization/global_start.h"
#include "localizer/models/motion_model.h"

namespace shiftmap {
namespace {

// Standard deviations of a start are taken for so many times as large.
constexpr double kInflation = 2.0;

// After the first start that is found, others are looked for so long. [s]
constexpr double kLookOnS = 60.0;

double Volume(const PoseWithCovariance& pose) { return pose.cov_T_map_vehicle.determinant(); }

}  // namespace

std::optional<RunStart> FindRunStart(const Run& run,
                                     const MapSnapshot& map,
                                     const OdometryCalibration& odometry) {
  const GlobalStartOptions options;
  std::deque<WindowScan> window;
  std::size_t hint = 0;
  std::optional<RunStart> best;
  Stamp last = Stamp::max();
  for (std::size_t i = 0; i < run.scans.size() && run.scans[i].stamp <= last; ++i) {
    WindowScan step{run.scans[i], {}};
    std::erase_if(step.scan.observations,
                  [](const Observation& observation) { return observation.signature.anonymous(); });
    if (i > 0) {
      step.motion.increment = IntegrateMotion(
          run.odometry, run.scans[i - 1].stamp, run.scans[i].stamp, odometry, &hint);
      step.motion.elapsed_s = ToSeconds(run.scans[i].stamp - run.scans[i - 1].stamp);
    }
    window.push_back(step);
    while (window.front().scan.stamp < step.scan.stamp - FromSeconds(options.window_s)) {
      window.pop_front();
    }
    if (step.scan.observations.empty()) continue;
    const std::vector<WindowScan> scans(window.begin(), window.end());
    const std::optional<GlobalStart> found = FindRecentStart(scans, map, options);
    if (!found) continue;
    if (!best) last = run.scans[i].stamp + FromSeconds(kLookOnS);
    if (best && Volume(found->pose) >= Volume(best->pose)) continue;
    best = RunStart{i + 1 - scans.size() + found->scan, found->pose};
  }
  if (best) best->pose.cov_T_map_vehicle *= kInflation * kInflation;
  return best;
}

}  // namespace shiftmap
