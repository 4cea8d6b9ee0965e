// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "mapper/graph/robust_loss.h"
#include "mapper/state/build_state.h"
#include "mapstore/map/calibration.h"

namespace shiftmap {

/// Where one sighting puts its landmark in the map.
struct SeenPlace {
  Eigen::Vector2d position = Eigen::Vector2d::Zero();  ///< [m]
  Eigen::Matrix2d cov = Eigen::Matrix2d::Zero();       ///< By the noise of the sensor. [m²]
};

/// Of the sightings of a visit, in their order, from the present poses.
std::vector<SeenPlace> SeenPlaces(const BuildState& build,
                                  const BuildRun& run,
                                  const MappingVisit& visit);

/// What the sightings of a visit say of where the landmark stands. They are false alarms; of the
/// landmark, at q as the poses of the visit have it; or of something that is misread as the
/// landmark, often in a burst of scans, at b:
///
///   f(q) = Π (P_D t_i(q) + β_FA) + β_B ∫ Π (P_D t_i(q) + P_D t_i(b) + β_FA) db
///
/// t_i is the density of the graph's loss (robust_loss.h) around the place of sighting i, a
/// bivariate t distribution. The error of pose and map is the same for all sightings of a visit, so
/// that q is known to be at a mode by no more than that error, however many sightings there are.
/// Integrals are by Laplace's method. Densities are per m², β_FA also per scan.
class VisitDensity {
 public:
  /// @param misread_density_per_m2  β_B.
  /// @param cluster_radius_m  Where sightings agree within it, the landmark is sought first.
  VisitDensity(const std::vector<SeenPlace>& seen,
               const SensorCalibration& sensor,
               double misread_density_per_m2,
               double cluster_radius_m);

  /// log ∫ N(q; p, cov) f(q) dq: the landmark is at the mode p.
  /// @param cov  Of the mode's position, and of the error of pose and map that the visit shares.
  ///             Precondition: positive definite.
  double LogUnderMode(const Eigen::Vector2d& p, const Eigen::Matrix2d& cov) const;

  /// log(f without a landmark + β_NT ∫ f(q) dq): the landmark is not there, or at a new place.
  double LogAbsent() const { return log_absent_; }

  /// Log of the product in f at given places: of the landmark and the misread object, of one of
  /// them, or of none.
  double LogGiven(const std::vector<Eigen::Vector2d>& places) const;

 private:
  struct Term {
    Eigen::Vector2d position;
    Eigen::Matrix2d information;
    double peak;  // P_D t_i at the position. [1/m²]
  };

  // Prior density of a place x: exp(log_peak - ½ (x - mean)ᵀ information (x - mean)).
  struct Prior {
    Eigen::Vector2d mean;
    Eigen::Matrix2d information;
    double log_peak;
  };

  // The landmark or the misread object.
  struct Object {
    Prior prior;
    Eigen::Vector2d place;
  };

  // Derivatives of the log-density of prior and sightings by the place of an object.
  struct Slope {
    Eigen::Vector2d slope;
    Eigen::Matrix2d information;  // The curvature that the slope's weights have.
    Eigen::Matrix2d curvature;
  };

  double Detection(const Term& term, const Eigen::Vector2d& place) const;
  Slope SlopeAt(const std::vector<Object>& objects, std::size_t k) const;

  // A further object with a flat prior, at the densest cluster of the sightings that no object
  // explains.
  std::optional<Object> Unexplained(const std::vector<Object>& objects, double log_density) const;

  // Log of the integral over the places of the objects, with and without a misread object.
  double LogIntegral(std::vector<Object> objects) const;

  // Moves the objects to the nearest maximum. Returns the log of the integral around it.
  double LogIntegralAround(std::vector<Object>* objects) const;

  RobustLoss loss_;
  double clutter_;  // [1/m²]
  double log_misread_;
  double cluster_radius_m_;
  std::vector<Term> terms_;
  std::optional<Eigen::Vector2d> place_;  // Where most sightings agree.
  double log_without_ = 0.0;              // Log of f without a landmark.
  double log_absent_ = 0.0;
};

}  // namespace shiftmap
