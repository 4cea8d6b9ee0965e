// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/visit_density.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "localizer/hypothesis/log_math.h"
#include "localizer/models/observation_model.h"
#include "mapper/graph/graph.h"
#include "mapper/state/sightings.h"

namespace shiftmap {
namespace {

// Least noise of a sighting: without it a covariance may be singular. [m]
constexpr double kLeastNoiseM = 0.01;

// Smaller shares of a density are neglected.
constexpr double kNegligible = 1e-3;

// Standard deviation of a place that may be anywhere. [m]
constexpr double kAnywhereM = 1e3;

// The loss of the graph. Its norm takes a continued fraction, once for all visits.
const RobustLoss& GraphLoss() {
  static const RobustLoss loss(Graph().loss_scale);
  return loss;
}

}  // namespace

std::vector<SeenPlace> SeenPlaces(const BuildState& build,
                                  const BuildRun& run,
                                  const MappingVisit& visit) {
  const std::vector<Eigen::Vector2d> positions = VisitPositions(run, visit);
  std::vector<SeenPlace> seen;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const Sighting& sighting = run.data->sightings[visit.sightings[i]];
    const Eigen::Matrix2d R = run.poses[sighting.frame].Rotation();
    const Eigen::Matrix2d cov = PositionNoiseInVehicle(
        sighting.observation, ObservationNoise(sighting.observation, build.sensor));
    seen.push_back({positions[i], R * cov * R.transpose()});
  }
  return seen;
}

VisitDensity::VisitDensity(const std::vector<SeenPlace>& seen,
                           const SensorCalibration& sensor,
                           double misread_density_per_m2,
                           double cluster_radius_m)
    : loss_(GraphLoss()),
      clutter_(sensor.clutter_density_per_m2),
      log_misread_(std::log(misread_density_per_m2)),
      cluster_radius_m_(cluster_radius_m) {
  // ∫ exp(-ρ/2) over a whitened residual, ρ/2 = a log(1 + r²/c²), is π c² / (a - 1).
  const double squared_scale = std::pow(Graph().loss_scale, 2);
  const double a = 0.5 * loss_.Weight(0.0) * squared_scale;
  const double norm = (a - 1.0) / (std::numbers::pi * squared_scale);
  for (const SeenPlace& place : seen) {
    const Eigen::Matrix2d cov =
        place.cov + kLeastNoiseM * kLeastNoiseM * Eigen::Matrix2d::Identity();
    const double peak = sensor.detection_probability * norm / std::sqrt(cov.determinant());
    // A sighting without a known place, or nowhere likelier than a false alarm, carries no
    // information.
    if (cov.trace() > kAnywhereM * kAnywhereM || peak <= clutter_) continue;
    terms_.push_back({place.position, cov.inverse(), peak});
  }
  log_without_ = LogIntegral({});
  log_absent_ = log_without_;
  if (const auto landmark = Unexplained({}, std::log(sensor.new_landmark_density_per_m2))) {
    std::vector<Object> objects = {*landmark};
    LogIntegralAround(&objects);
    place_ = objects.front().place;
    log_absent_ = LogAdd(log_absent_, LogIntegral(std::move(objects)));
  }
}

double VisitDensity::LogGiven(const std::vector<Eigen::Vector2d>& places) const {
  double sum = 0.0;
  for (const Term& term : terms_) {
    double density = clutter_;
    for (const Eigen::Vector2d& place : places) density += Detection(term, place);
    sum += std::log(density);
  }
  return sum;
}

double VisitDensity::LogUnderMode(const Eigen::Vector2d& p, const Eigen::Matrix2d& cov) const {
  const Prior prior{p, cov.inverse(), LogGaussian(Eigen::Vector2d::Zero(), cov)};
  // The integral has one maximum if the sightings agree near the mode, else two: at the mode and
  // at the sightings. The larger one is taken; the other one adds less than log 2. If all sightings
  // are too far off, the landmark was not seen.
  constexpr double kNearSd = 2.0;
  const double at_sightings = place_ ? LogGaussian(*place_ - p, cov) : kLogZero;
  const bool reach = at_sightings > log_misread_ + std::log(kNegligible);
  const bool near = at_sightings > prior.log_peak - 0.5 * kNearSd * kNearSd;
  if (near) return LogIntegral({{prior, *place_}});
  const bool seen = std::any_of(terms_.begin(), terms_.end(), [&](const Term& term) {
    return Detection(term, p) > kNegligible * clutter_;
  });
  const double at_mode = seen ? LogIntegral({{prior, p}}) : log_without_;
  return reach ? std::max(at_mode, LogIntegral({{prior, *place_}})) : at_mode;
}

double VisitDensity::Detection(const Term& term, const Eigen::Vector2d& place) const {
  const Eigen::Vector2d d = term.position - place;
  return term.peak * std::exp(-loss_.HalfLoss(d.dot(term.information * d)));
}

std::optional<VisitDensity::Object> VisitDensity::Unexplained(const std::vector<Object>& objects,
                                                              double log_density) const {
  std::vector<Eigen::Vector2d> positions;
  for (const Term& term : terms_) {
    const bool explained = std::any_of(objects.begin(), objects.end(), [&](const Object& object) {
      return Detection(term, object.place) > clutter_;
    });
    if (!explained) positions.push_back(term.position);
  }
  if (positions.empty()) return std::nullopt;
  const Eigen::Vector2d centre = DensestCluster(positions, cluster_radius_m_).centre;
  const Eigen::Vector2d nearest =
      *std::min_element(positions.begin(), positions.end(), [&](const auto& x, const auto& y) {
        return (x - centre).squaredNorm() < (y - centre).squaredNorm();
      });
  return Object{{nearest, Eigen::Matrix2d::Identity() / (kAnywhereM * kAnywhereM), log_density},
                nearest};
}

double VisitDensity::LogIntegral(std::vector<Object> objects) const {
  const double without = LogIntegralAround(&objects);
  const std::optional<Object> misread = Unexplained(objects, log_misread_);
  if (!misread) return without;
  objects.push_back(*misread);
  return LogAdd(without, LogIntegralAround(&objects));
}

double VisitDensity::LogIntegralAround(std::vector<Object>* objects) const {
  constexpr int kMaxSteps = 20;
  constexpr double kSettledM = 1e-3;
  double longest = 2.0 * kSettledM;
  for (int i = 0; i < kMaxSteps && longest > kSettledM; ++i) {
    longest = 0.0;
    for (std::size_t k = 0; k < objects->size(); ++k) {
      const Slope slope = SlopeAt(*objects, k);
      const Eigen::Vector2d step = slope.information.inverse() * slope.slope;
      (*objects)[k].place += step;
      longest = std::max(longest, step.norm());
    }
  }
  std::vector<Eigen::Vector2d> places;
  double sum = 0.0;
  for (std::size_t k = 0; k < objects->size(); ++k) {
    const auto& [prior, place] = (*objects)[k];
    const Eigen::Vector2d d = place - prior.mean;
    sum += prior.log_peak - 0.5 * d.dot(prior.information * d) + std::log(2.0 * std::numbers::pi) -
           0.5 * std::log(SlopeAt(*objects, k).curvature.determinant());
    places.push_back(place);
  }
  return sum + LogGiven(places);
}

VisitDensity::Slope VisitDensity::SlopeAt(const std::vector<Object>& objects, std::size_t k) const {
  const auto& [prior, place] = objects[k];
  Slope at{prior.information * (prior.mean - place), prior.information, prior.information};
  for (const Term& term : terms_) {
    const Eigen::Vector2d d = term.position - place;
    const Eigen::Vector2d pull = term.information * d;
    const double squared = d.dot(pull);
    const double detection = term.peak * std::exp(-loss_.HalfLoss(squared));
    double all = clutter_ + detection;
    for (std::size_t other = 0; other < objects.size(); ++other)
      if (other != k) all += Detection(term, objects[other].place);
    const double share = detection / all;
    at.slope += share * loss_.Slope(squared) * pull;
    at.information += share * loss_.Weight(squared) * term.information;
    at.curvature += share * loss_.Curvature(squared) * term.information;
  }
  return at;
}

}  // namespace shiftmap
