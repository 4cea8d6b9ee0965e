// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/vehicle_update.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

#include "mapstore/core/day.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/run_spread.h"

namespace shiftmap {
namespace {

using Vector = SystematicErrors::Vector;
using Matrix = SystematicErrors::Matrix;

// What is less probable under the calibration before is a repair, a new wheel or sensor: that is
// forgotten.
constexpr double kContradiction = 1e-6;

// What is remembered of a noise, in degrees of freedom, and of detections, in trials.
constexpr double kMaxDof = 800.0;
constexpr double kMaxTrials = 10000.0;

// What the systematic errors wander, per square root of a day.
Vector Walk() { return {0.001, 0.001, 0.002, 0.001, 0.005}; }

template <typename Calibration>
auto SystematicOf(Calibration* vehicle) {
  return std::array{&vehicle->log_scale_v,
                    &vehicle->log_scale_omega,
                    &vehicle->lag_s,
                    &vehicle->bearing_offset_rad,
                    &vehicle->range_curvature_per_rad2};
}

// Independent normal distributions.
struct Normals {
  Vector mean;
  Vector variance;
};

Normals KnownAt(const VehicleCalibration& vehicle, Stamp now) {
  const double days = std::max(0.0, ToSeconds(now - vehicle.stamp) / kSecondsPerDay);
  Normals known{Vector::Zero(), Walk().cwiseAbs2() * days};
  Eigen::Index i = 0;
  for (const Estimate* estimate : SystematicOf(&vehicle)) {
    known.mean[i] = estimate->value;
    known.variance[i++] += estimate->sd * estimate->sd;
  }
  return known;
}

Normals FleetOf(const SystematicErrors& found) {
  return {found.prior_mean, found.prior_sd.cwiseAbs2()};
}

// A normal density in information form.
struct Information {
  Matrix matrix;
  Vector vector;
};

// What the runs by themselves say of their vehicle.
Information FromRuns(const SystematicErrors& found, std::int64_t runs) {
  const Vector of_prior = found.prior_sd.cwiseAbs2().cwiseInverse();
  const Matrix posterior = found.cov.llt().solve(Matrix::Identity());
  Matrix L = posterior;
  L.diagonal() -= of_prior;
  const Vector h = posterior * found.mean - of_prior.cwiseProduct(found.prior_mean);
  Vector spread{kRunSpread.log_scale,
                kRunSpread.log_scale,
                kRunSpread.lag_s,
                kRunSpread.bearing_offset_rad,
                kRunSpread.range_curvature_per_rad2};
  spread = spread.cwiseAbs2() / static_cast<double>(runs);
  const Eigen::PartialPivLU<Matrix> damping(Matrix::Identity() + L * spread.asDiagonal());
  return {Symmetrized(damping.solve(L)), damping.solve(h)};
}

struct Posterior {
  Vector mean;
  Matrix cov;
};

Posterior Combined(const Normals& before, const Information& runs) {
  const Vector of_before = before.variance.cwiseInverse();
  Matrix information = runs.matrix;
  information.diagonal() += of_before;
  const Eigen::LLT<Matrix> factor(information);
  return {factor.solve(runs.vector + of_before.cwiseProduct(before.mean)),
          factor.solve(Matrix::Identity())};
}

bool Contradicts(const Normals& known, const Posterior& alone) {
  const Vector difference = alone.mean - known.mean;
  const Matrix cov = alone.cov + Matrix(known.variance.asDiagonal());
  return difference.dot(cov.llt().solve(difference)) >
         ChiSquareQuantile(1.0 - kContradiction, static_cast<int>(difference.size()));
}

void SetSystematic(const Posterior& posterior, VehicleCalibration* vehicle) {
  Eigen::Index i = 0;
  for (Estimate* estimate : SystematicOf(vehicle)) {
    *estimate = {posterior.mean[i], std::sqrt(posterior.cov(i, i))};
    ++i;
  }
}

NoiseEstimate Pooled(const NoiseEstimate& known, const NoiseEstimate& found) {
  if (!known.known() || !found.known()) return known.known() ? known : found;
  const double dof = known.dof + found.dof;
  const double squares = known.dof * known.sd * known.sd + found.dof * found.sd * found.sd;
  return {std::sqrt(squares / dof), dof};
}

ShareEstimate Pooled(const ShareEstimate& known, const ShareEstimate& found) {
  const double trials = known.trials + found.trials;
  if (trials == 0.0) return known;
  const double hits = known.share * known.trials + found.share * found.trials;
  return {hits / trials, trials};
}

double Mean(double a, std::int64_t weight_a, double b, std::int64_t weight_b) {
  const auto share = static_cast<double>(weight_b) / static_cast<double>(weight_a + weight_b);
  return a + share * (b - a);
}

void Pool(const VehicleCalibration& before, VehicleCalibration* vehicle) {
  vehicle->mean_squared_bearing_rad2 = Mean(before.mean_squared_bearing_rad2,
                                            before.runs,
                                            vehicle->mean_squared_bearing_rad2,
                                            vehicle->runs);
  vehicle->runs += before.runs;
  vehicle->stamp = std::max(before.stamp, vehicle->stamp);
  vehicle->noise_v = Pooled(before.noise_v, vehicle->noise_v);
  vehicle->noise_omega = Pooled(before.noise_omega, vehicle->noise_omega);
  vehicle->range_m = Pooled(before.range_m, vehicle->range_m);
  vehicle->bearing_rad = Pooled(before.bearing_rad, vehicle->bearing_rad);
  vehicle->position_m = Pooled(before.position_m, vehicle->position_m);
  vehicle->detection = Pooled(before.detection, vehicle->detection);
}

// Bounds what is remembered, so that the calibration follows the vehicle.
void Bound(VehicleCalibration* vehicle) {
  for (NoiseEstimate* noise : {&vehicle->noise_v,
                               &vehicle->noise_omega,
                               &vehicle->range_m,
                               &vehicle->bearing_rad,
                               &vehicle->position_m}) {
    noise->dof = std::min(noise->dof, kMaxDof);
  }
  vehicle->detection.trials = std::min(vehicle->detection.trials, kMaxTrials);
}

// @param before  Null: the map does not know the vehicle.
VehicleCalibration Updated(const VehicleCalibration* before, const VehicleEstimate& estimate) {
  VehicleCalibration vehicle = estimate.calibration;
  const Information runs = FromRuns(estimate.systematic, vehicle.runs);
  const Posterior alone = Combined(FleetOf(estimate.systematic), runs);
  SetSystematic(alone, &vehicle);
  Bound(&vehicle);
  if (before == nullptr) return vehicle;
  const Normals known = KnownAt(*before, vehicle.stamp);
  if (Contradicts(known, alone)) return vehicle;
  SetSystematic(Combined(known, runs), &vehicle);
  Pool(*before, &vehicle);
  Bound(&vehicle);
  return vehicle;
}

}  // namespace

void UpdateVehicles(const std::vector<VehicleEstimate>& found,
                    std::vector<VehicleCalibration>* known) {
  for (const VehicleEstimate& estimate : found) {
    if (estimate.vehicle.empty()) continue;
    const auto place = std::lower_bound(
        known->begin(), known->end(), estimate.vehicle, [](const auto& vehicle, const auto& name) {
          return vehicle.vehicle < name;
        });
    const bool is_known = place != known->end() && place->vehicle == estimate.vehicle;
    VehicleCalibration updated = Updated(is_known ? &*place : nullptr, estimate);
    if (!ValidateVehicleCalibration(updated).ok()) continue;
    if (is_known) {
      *place = std::move(updated);
    } else {
      known->insert(place, std::move(updated));
    }
  }
}

}  // namespace shiftmap
