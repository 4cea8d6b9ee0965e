// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/moved_bodies.h"

#include <cmath>
#include <numbers>

#include "localizer/hypothesis/log_math.h"
#include "mapstore/geometry/se2.h"

namespace shiftmap {
namespace {

double LogNormal(double x, double variance) {
  return -0.5 * x * x / variance - 0.5 * std::log(kTwoPi * variance);
}

double LogNormal(const Eigen::Vector2d& r, double variance_per_axis) {
  return -0.5 * r.squaredNorm() / variance_per_axis - std::log(kTwoPi * variance_per_axis);
}

// A position in the other map as one in the reference.
Eigen::Vector2d Back(const SimilarityFit& map, const Eigen::Vector2d& p_other) {
  const Eigen::Matrix2d R = Se2(0.0, 0.0, -map.yaw_rad).Rotation();
  return map.centre_reference + std::exp(-map.log_scale) * (R * (p_other - map.centre_other));
}

// Variance per axis of where a transform has a position. [m²]
double VarianceAt(const SimilarityFit& fit, const Eigen::Vector2d& p_reference) {
  return 0.5 * fit.covariance.topLeftCorner<2, 2>().trace() +
         (p_reference - fit.centre_reference).squaredNorm() * fit.covariance(2, 2);
}

}  // namespace

MovedBodies MovedBodies::With(const Body& body) const {
  MovedBodies more = *this;
  more.matches_.push_back(body.matches);
  more.bodies_.push_back(&body);
  more.log_went_.push_back(LogWent(body));
  double log_went = more.log_went_.back();
  if (!bodies_.empty() && stayed_->fit != nullptr) {
    const double log_each =
        std::log(e_->prior().exchange_share / static_cast<double>(bodies_.size()));
    log_went += std::log1p(-e_->prior().exchange_share);
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      // A scattered body has no place that another could take.
      const double log_both = std::log1p(-body.scattered) + std::log1p(-bodies_[i]->scattered);
      log_went =
          LogAdd(log_went, log_each + log_both + LogExchanged(*bodies_[i], body) - log_went_[i]);
    }
  }
  more.log_gain_ += body.log_evidence + log_went;
  for (const MatchIndex k : body.matches.Members()) {
    more.log_gain_ -= stayed_->log_moved[e_->LandmarkOf(k)];
  }
  return more;
}

double MovedBodies::LogScore() const {
  return log_gain_ + (stayed_->fit == nullptr ? rigid_->LogAllMoved(matches_)
                                              : rigid_->LogStaying(stayed_->matches, matches_));
}

// log density of where a body went, against anywhere in the area and any heading.
double MovedBodies::LogWent(const Body& body) const {
  constexpr double kNoVariance = 1e-4;  // [m²]
  if (stayed_->fit == nullptr) return 0.0;
  const SimilarityFit& map = *stayed_->fit;
  const double turn = std::remainder(body.fit.yaw_rad - map.yaw_rad, kTwoPi);
  const double same_heading =
      kTwoPi * std::exp(LogNormal(turn, std::pow(e_->prior().same_heading_sd_rad, 2)));
  const double any_turn = 0.5 * (1.0 - body.scattered);
  return e_->LogMovedBy(body.fit.centre_other - map * body.fit.centre_reference,
                        kNoVariance * Eigen::Matrix2d::Identity()) +
         e_->log_area() + std::log(any_turn + (1.0 - any_turn) * same_heading);
}

// log density of where two bodies went that changed places, against anywhere.
double MovedBodies::LogExchanged(const Body& a, const Body& b) const {
  const SimilarityFit& map = *stayed_->fit;
  const MovePrior& prior = e_->prior();
  const double heading_variance = std::pow(prior.same_heading_sd_rad, 2);
  const Eigen::Vector2d& from = a.fit.centre_reference;
  const Eigen::Vector2d to = Back(map, a.fit.centre_other);
  const double map_variance = VarianceAt(map, from) + VarianceAt(map, to);
  const double slot = LogNormal(Eigen::Vector2d(to - b.fit.centre_reference),
                                std::pow(prior.slot_sd_m, 2) + map_variance);
  const double back = LogNormal(Eigen::Vector2d(Back(map, b.fit * to) - from),
                                std::pow(prior.exchange_sd_m, 2) + 2.0 * map_variance +
                                    VarianceAt(b.fit, to) + VarianceAt(a.fit, from));
  const double turn = std::remainder(a.fit.yaw_rad - map.yaw_rad, kTwoPi);
  const double half_turn = std::remainder(turn - std::numbers::pi, kTwoPi);
  const double turn_back = std::remainder(b.fit.yaw_rad - map.yaw_rad + turn, kTwoPi);
  // Racks that change places face as before, or the other way, in half of all cases.
  const double straight = std::exp(LogNormal(turn, heading_variance)) +
                          std::exp(LogNormal(half_turn, heading_variance));
  const double turned =
      LogNormal(turn_back,
                std::pow(prior.exchange_heading_sd_rad, 2) + 4.0 * map.covariance(2, 2) +
                    a.fit.covariance(2, 2) + b.fit.covariance(2, 2));
  return slot + back + 2.0 * e_->log_area() + std::log(0.5 + 0.25 * kTwoPi * straight) + turned +
         std::log(kTwoPi);
}

}  // namespace shiftmap
