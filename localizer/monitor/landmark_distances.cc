// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/landmark_distances.h"

#include <cmath>

#include "localizer/models/observation_model.h"

namespace shiftmap {
namespace {

// Two landmarks are as far apart as two modes if their distance is inside these.
constexpr double kDistanceSigmas = 3.0;

bool ModesAsFarApart(const LandmarkGroup& a,
                     const LandmarkGroup& b,
                     double distance_m,
                     double variance_m2) {
  for (const Mode& mode_a : a.modes) {
    for (const Mode& mode_b : b.modes) {
      const double mismatch = (mode_a.p_map_landmark - mode_b.p_map_landmark).norm() - distance_m;
      const double modes =
          0.5 * mode_a.cov_p_map_landmark.trace() + 0.5 * mode_b.cov_p_map_landmark.trace();
      if (std::abs(mismatch) < kDistanceSigmas * std::sqrt(variance_m2 + modes)) return true;
    }
  }
  return false;
}

bool AsInMap(const Observation& a, const Observation& b, const MapSnapshot& snapshot) {
  const SensorCalibration& sensor = snapshot.calibration().sensor;
  const Eigen::Vector2d d = a.PositionInVehicle() - b.PositionInVehicle();
  const Eigen::Matrix2d cov = PositionNoiseInVehicle(a, ObservationNoise(a, sensor)) +
                              PositionNoiseInVehicle(b, ObservationNoise(b, sensor));
  const auto group_of = [&](const Observation& observation) -> const LandmarkGroup& {
    return snapshot.groups()[static_cast<std::size_t>(snapshot.GroupIndex(observation.signature))];
  };
  return ModesAsFarApart(group_of(a), group_of(b), d.norm(), d.dot(cov * d) / d.squaredNorm());
}

}  // namespace

FailingPairs CompareDistances(const Scan& scan,
                              const std::vector<ObservationOutcome>& outcomes,
                              const MapSnapshot& snapshot) {
  FailingPairs result;
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    if (outcomes[i].gated_any) continue;
    for (std::size_t j = 0; j < i; ++j) {
      if (outcomes[j].gated_any) continue;
      ++result.pairs;
      result.as_in_map += AsInMap(
          scan.observations[outcomes[i].index], scan.observations[outcomes[j].index], snapshot);
    }
  }
  return result;
}

}  // namespace shiftmap
