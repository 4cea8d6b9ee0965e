// SPDX-License-Identifier: Apache-2.0
#include "mapper/tree/anonymous_update.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "localizer/models/observation_model.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

double LogGaussianOf(const JointInnovation& joint) {
  const Eigen::LLT<Eigen::MatrixXd> llt(joint.S);
  if (llt.info() != Eigen::Success) return 0.0;  // Nothing was updated.
  const Eigen::VectorXd whitened = llt.matrixL().solve(joint.nu);
  const double log_det = 2.0 * llt.matrixLLT().diagonal().array().log().sum();
  const double dimensions = static_cast<double>(joint.nu.size());
  return -0.5 * (whitened.squaredNorm() + log_det + dimensions * std::log(2.0 * std::numbers::pi));
}

bool IsConfirmed(const AnonymousLandmark& landmark, const AnonymousOptions& options) {
  return landmark.sightings >= options.confirm_sightings;
}

std::vector<int> ActiveLandmarks(const std::vector<AnonymousLandmark>& known,
                                 bool confirmed,
                                 const AnonymousOptions& options,
                                 const SlamState& state) {
  std::vector<int> landmarks;
  for (const AnonymousLandmark& landmark : known) {
    if (IsConfirmed(landmark, options) == confirmed && state.IsActive(landmark.landmark)) {
      landmarks.push_back(landmark.landmark);
    }
  }
  return landmarks;
}

bool IsIsolated(const AnonymousOptions& options,
                const Observation& observation,
                const std::vector<AnonymousLandmark>& known,
                const SlamState& state) {
  const double gate = ChiSquareQuantile(options.isolation_probability, 2);
  const double slack_m = PlaceSlack(state, observation.PositionInVehicle().norm());
  const Eigen::Vector2d p = LandmarkPosition(observation, state.pose());
  return std::none_of(known.begin(), known.end(), [&](const AnonymousLandmark& landmark) {
    if (!state.IsActive(landmark.landmark)) return false;
    if ((state.Position(landmark.landmark) - p).norm() > slack_m) return false;
    Eigen::Matrix2d S;
    const Innovation innovation = state.Linearized({landmark.landmark, &observation}, &S);
    return SquaredMahalanobis(innovation.nu, S) < gate;
  });
}

}  // namespace

double UpdateAnonymous(const Scan& scan,
                       std::span<const int> observations,
                       int scan_number,
                       const SensorCalibration& sensor,
                       const AnonymousOptions& options,
                       std::vector<AnonymousLandmark>* known,
                       SlamState* state) {
  double log_likelihood = 0.0;
  std::vector<int> free(observations.begin(), observations.end());
  for (const bool confirmed : {true, false}) {
    SlamAssociation found = AssociateLandmarks(scan,
                                               free,
                                               ActiveLandmarks(*known, confirmed, options, *state),
                                               PlaceSlack(*state, sensor.max_range_m),
                                               options.association,
                                               {.gate_probability = options.gate_probability},
                                               *state);
    free = std::move(found.left);
    if (found.pairs.empty()) continue;
    log_likelihood += LogGaussianOf(state->Update(found.pairs));
    for (const SlamPair& pair : found.pairs) {
      log_likelihood += std::log(sensor.detection_probability);
      const auto seen = std::find_if(known->begin(), known->end(), [&](const auto& landmark) {
        return landmark.landmark == pair.landmark;
      });
      ++seen->sightings;
      seen->last_seen = scan.stamp;
    }
  }
  const double density = sensor.clutter_density_per_m2 + sensor.new_landmark_density_per_m2;
  for (const int i : free) {
    const Observation& observation = scan.observations[static_cast<std::size_t>(i)];
    log_likelihood += std::log(density * SquareMetresPerUnit(observation));
    if (!IsIsolated(options, observation, *known, *state)) continue;
    known->push_back({state->Add(observation), 1, scan_number, scan.stamp});
  }
  std::erase_if(*known, [&](const AnonymousLandmark& landmark) {
    const bool expired = !IsConfirmed(landmark, options) &&
                         scan_number - landmark.first_scan >= options.confirm_within_scans;
    if (expired) state->Remove(landmark.landmark);
    return expired;
  });
  return log_likelihood;
}

}  // namespace shiftmap
