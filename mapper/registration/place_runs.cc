// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/place_runs.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "mapper/calibration/noise_calibration.h"
#include "mapper/mapped_run.h"
#include "mapper/registration/place_run_maps.h"
#include "mapstore/map/map_scale.h"

namespace shiftmap {
namespace {

// What the runs by themselves say of the sensor, as the start of the common estimate.
SensorCalibration RmsSensor(const std::vector<RunMap>& run_maps,
                            const SensorCalibration& fallback) {
  if (run_maps.empty()) return fallback;
  SensorCalibration mean = fallback;
  const auto average = [&](double SensorCalibration::*member) {
    double sum = 0.0;
    for (const RunMap& run_map : run_maps) sum += std::pow(run_map.build.sensor.*member, 2);
    mean.*member = std::sqrt(sum / static_cast<double>(run_maps.size()));
  };
  average(&SensorCalibration::sd_range_m);
  average(&SensorCalibration::sd_bearing_rad);
  average(&SensorCalibration::sd_position_m);
  return mean;
}

}  // namespace

StatusOr<BuildState> PlaceRuns(std::vector<RunMap> run_maps,
                               const std::vector<Signature>& signatures,
                               const std::optional<MapContent>& prior,
                               const MapperOptions& options,
                               BuildWatch* watch,
                               std::vector<RejectedRun>* rejected) {
  std::optional<MapContent> known = prior;
  const double sd_scale = known ? RemoveScale(options.sd_range_scale, &*known).sd : 0.0;
  const SensorCalibration sensor = RmsSensor(run_maps, options.calibration.sensor);
  BuildState build =
      known ? StartBuild(signatures, *known, sensor) : StartBuild(signatures.size(), sensor);
  build.sd_scale = sd_scale;
  PlaceRunMaps(options,
               known,
               std::move(run_maps),
               &build,
               rejected,
               watch->During("placing runs", kSingleRunsShare));
  SHIFTMAP_RETURN_IF_ERROR(watch->status());
  SHIFTMAP_RETURN_IF_ERROR(RequireRuns(!build.runs.empty() || !build.waiting.empty(), *rejected));
  if (build.runs.empty()) return build;
  std::stable_sort(build.runs.begin(), build.runs.end(), [](const BuildRun& a, const BuildRun& b) {
    return std::tie(a.data->begin, a.data->sha256) < std::tie(b.data->begin, b.data->sha256);
  });
  if (!prior) AnchorFrame(&build);
  if (options.calibrate) PoolNoiseByVehicle(&build);
  return build;
}

}  // namespace shiftmap
