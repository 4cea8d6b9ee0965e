// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/distortion_calibration.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "mapper/graph/graph_posterior.h"
#include "mapper/graph/residuals.h"
#include "mapper/graph/sensor_distortion.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/geometry/inner_constraints.h"

namespace shiftmap {
namespace {

constexpr int kRange = 0;
constexpr int kBearing = 1;

using Monomials = SensorDistortion::Monomials;

// Observations of each vehicle; of all under none.
using ObservationsByVehicle = std::map<std::optional<std::size_t>, std::vector<ObservationIndex>>;

// One of a vehicle's sensor, of its range or its bearing.
struct ErrorFunction {
  std::optional<std::size_t> vehicle;  // Of all alike if none.
  int row = kRange;
  Monomials coefficients;  // Mean square 1 over the vehicle's observations.
  double prior_sd = 0.0;   // [m] or [rad]
};

// Monomials that differ from those before by less than this part, squared, are left out.
constexpr double kLeastPart = 1e-6;

// The errors that SensorBias has: scale and curvature of ranges, offset of bearings.
std::vector<int> OfSensorBias(int row) {
  if (row == kBearing) return {SensorDistortion::kOne};
  return {SensorDistortion::kR, SensorDistortion::kRBB};
}

// Polynomials of second degree that are orthonormal over observations, and orthogonal to the errors
// in SensorBias, by Gram and Schmidt.
std::vector<Monomials> OrthonormalOver(const Graph& graph,
                                       const std::vector<ObservationIndex>& observations,
                                       int row) {
  Eigen::Matrix<double, SensorDistortion::kMonomials, SensorDistortion::kMonomials> products =
      decltype(products)::Zero();
  for (const ObservationIndex i : observations) {
    const Monomials m = SensorDistortion::MonomialsOf(graph.observations[i].observation);
    products += m * m.transpose() / static_cast<double>(observations.size());
  }
  std::vector<Monomials> functions;
  const auto append = [&](int monomial) {
    Monomials rest = Monomials::Unit(monomial);
    for (const Monomials& other : functions) rest -= other.dot(products * rest) * other;
    const double squared = rest.dot(products * rest);
    if (squared <= kLeastPart * products(monomial, monomial)) return;
    functions.push_back(rest / std::sqrt(squared));
  };
  for (const int monomial : OfSensorBias(row)) append(monomial);
  const auto known = static_cast<std::ptrdiff_t>(functions.size());
  for (int monomial = SensorDistortion::kOne; monomial <= SensorDistortion::kBB; ++monomial) {
    append(monomial);
  }
  functions.erase(functions.begin(), functions.begin() + known);
  return functions;
}

// Those of one vehicle.
void AppendFunctions(const MapperOptions& options,
                     const SensorCalibration& sensor,
                     const Graph& graph,
                     const std::vector<ObservationIndex>& observations,
                     std::size_t vehicle,
                     std::vector<ErrorFunction>* functions) {
  Eigen::Vector2d sd(sensor.sd_range_m, sensor.sd_bearing_rad);
  if (graph.observations[observations.front()].observation.kind == Observation::Kind::kCartesian) {
    double squared_ranges = 0.0;
    for (const ObservationIndex i : observations) {
      squared_ranges += graph.observations[i].observation.z.squaredNorm();
    }
    const auto count = static_cast<double>(observations.size());
    sd << sensor.sd_position_m, sensor.sd_position_m / std::sqrt(squared_ranges / count);
  }
  for (const int row : {kRange, kBearing}) {
    const std::vector<Monomials> orthonormal = OrthonormalOver(graph, observations, row);
    const auto count = static_cast<double>(orthonormal.size());
    for (const Monomials& function : orthonormal) {
      functions->push_back(
          {vehicle, row, function, options.distortion_share * sd[row] / std::sqrt(count)});
    }
  }
}

// The functions as standardized residuals: by how much an observation's change with (range,
// bearing), times the root of its weight.
class DistortedResiduals {
 public:
  // @param observations  Of the graph; both must outlive this.
  DistortedResiduals(const Graph& graph, const ObservationsByVehicle& observations)
      : graph_(graph), observations_(observations) {
    const IndexedVector<RunIndex, RobustLoss> losses = LossesOf(graph);
    for (const GraphObservation& item : graph.observations) {
      const GraphRun& run = graph.runs[item.run];
      const ObservationResidual residual(item);
      const double squared = residual
                                 .ResidualAt(run.poses[item.frame],
                                             run.poses[item.frame].Rotation(),
                                             graph.modes[item.mode],
                                             run.sensor_bias)
                                 .squaredNorm();
      by_polar_.push_back(std::sqrt(losses[item.run].Curvature(squared)) *
                          residual.Whitened(SensorDistortion::DzDPolar(item.observation)));
      monomials_.push_back(SensorDistortion::MonomialsOf(item.observation));
    }
  }

  GraphResiduals Of(const ErrorFunction& function) const {
    GraphResiduals residuals;
    for (const GraphRun& run : graph_.runs) {
      residuals.motions.push_back(Eigen::Matrix3Xd::Zero(3, std::ssize(run.motions)));
    }
    residuals.observations.setZero(2, std::ssize(graph_.observations));
    for (const ObservationIndex i : observations_.at(function.vehicle)) {
      residuals.observations.col(i.value()) = At(function, i);
    }
    return residuals;
  }

  double Dot(const ErrorFunction& function, const GraphResiduals& residuals) const {
    double sum = 0.0;
    for (const ObservationIndex i : observations_.at(function.vehicle)) {
      sum += At(function, i).dot(residuals.observations.col(i.value()));
    }
    return sum;
  }

 private:
  Eigen::Vector2d At(const ErrorFunction& function, ObservationIndex i) const {
    return by_polar_[i].col(function.row) * function.coefficients.dot(monomials_[i]);
  }

  const Graph& graph_;
  const ObservationsByVehicle& observations_;
  IndexedVector<ObservationIndex, Eigen::Matrix2d> by_polar_;
  IndexedVector<ObservationIndex, Monomials> monomials_;
};

// The normal equations of the amplitudes of functions, with all of a graph eliminated.
struct AmplitudeSystem {
  Eigen::MatrixXd information;  // Φᵀ (I - J H⁻¹ Jᵀ) Φ
  Eigen::VectorXd gradient;     // Φᵀ e
  Eigen::MatrixXd mode_steps;   // H⁻¹ Jᵀ Φ
};

AmplitudeSystem EliminateGraph(const Graph& graph,
                               const GraphPosterior& posterior,
                               const DistortedResiduals& distorted,
                               const std::vector<ErrorFunction>& functions) {
  const GraphResiduals present = PresentResiduals(graph);
  const Eigen::Index size = std::ssize(functions);
  AmplitudeSystem system{Eigen::MatrixXd(size, size),
                         Eigen::VectorXd(size),
                         Eigen::MatrixXd(2 * graph.modes.end_index(), size)};
  for (std::size_t k = 0; k < functions.size(); ++k) {
    system.gradient[static_cast<Eigen::Index>(k)] = distorted.Dot(functions[k], present);
  }
  for (std::size_t first = 0; first < functions.size(); first += kFunctionsAtOnce) {
    std::vector<GraphResiduals> errors;
    for (std::size_t k = first; k < std::min(functions.size(), first + kFunctionsAtOnce); ++k) {
      errors.push_back(distorted.Of(functions[k]));
    }
    const GraphPosterior::Fit fit = posterior.FitTo(std::move(errors));
    const auto column = static_cast<Eigen::Index>(first);
    system.mode_steps.middleCols(column, fit.mode_steps.cols()) = fit.mode_steps;
    for (Eigen::Index row = 0; row < size; ++row) {
      for (std::size_t k = 0; k < fit.left.size(); ++k) {
        system.information(row, column + static_cast<Eigen::Index>(k)) =
            distorted.Dot(functions[static_cast<std::size_t>(row)], fit.left[k]);
      }
    }
  }
  return system;
}

// By how much each function makes the map grow, as the scale of all ranges does. [-]
Eigen::VectorXd GrowthOf(const Graph& graph, const Eigen::MatrixXd& mode_steps) {
  const Eigen::VectorXd offsets = OffsetsFromCentroid(graph.modes);
  // An error moves the minimum against the step.
  return -mode_steps.transpose() * offsets / offsets.squaredNorm();
}

// The system of the functions less their growth times the last one, the scale of all ranges: the
// size of the map stays. A smaller map has smaller residuals of motions, which would count for it.
AmplitudeSystem WithoutGrowth(const AmplitudeSystem& all, const Eigen::VectorXd& growth) {
  const Eigen::Index size = growth.size();
  Eigen::MatrixXd combination(size + 1, size);
  combination << Eigen::MatrixXd::Identity(size, size), -growth.transpose();
  return {combination.transpose() * all.information * combination,
          combination.transpose() * all.gradient,
          all.mode_steps * combination};
}

// By run, from 0 on.
IndexedVector<RunIndex, std::size_t> VehicleOfRun(const BuildState& build) {
  IndexedVector<RunIndex, std::size_t> vehicles(build.runs.size(), 0);
  std::size_t vehicle = 0;
  for (const auto& [name, runs] : RunsByVehicle(build)) {
    for (const RunIndex r : runs) vehicles[r] = vehicle;
    ++vehicle;
  }
  return vehicles;
}

ObservationsByVehicle GroupByVehicle(const Graph& graph,
                                     const IndexedVector<RunIndex, std::size_t>& vehicles) {
  ObservationsByVehicle observations;
  for (const ObservationIndex i : graph.observations.indices()) {
    observations[vehicles[graph.observations[i].run]].push_back(i);
    observations[std::nullopt].push_back(i);
  }
  return observations;
}

// Those of all vehicles, and last the scale of all ranges.
std::vector<ErrorFunction> FunctionsOf(const MapperOptions& options,
                                       const SensorCalibration& sensor,
                                       const Graph& graph,
                                       const ObservationsByVehicle& observations) {
  std::vector<ErrorFunction> functions;
  for (const auto& [vehicle, of_vehicle] : observations) {
    if (vehicle) AppendFunctions(options, sensor, graph, of_vehicle, *vehicle, &functions);
  }
  functions.push_back({std::nullopt, kRange, Monomials::Unit(SensorDistortion::kR), 0.0});
  return functions;
}

// Sets the distortions of a build, which its graph does not have yet.
// @param posterior  Of the graph.
void SetDistortions(const MapperOptions& options,
                    const Graph& graph,
                    const GraphPosterior& posterior,
                    BuildState* build) {
  const IndexedVector<RunIndex, std::size_t> vehicles = VehicleOfRun(*build);
  const ObservationsByVehicle observations = GroupByVehicle(graph, vehicles);
  const std::vector<ErrorFunction> functions =
      FunctionsOf(options, build->sensor, graph, observations);
  const AmplitudeSystem all =
      EliminateGraph(graph, posterior, DistortedResiduals(graph, observations), functions);
  const Eigen::Index size = std::ssize(functions) - 1;
  const Eigen::VectorXd growth = GrowthOf(graph, all.mode_steps.leftCols(size));
  const AmplitudeSystem system = WithoutGrowth(all, growth);
  // In prior standard deviations: the prior is the identity.
  Eigen::VectorXd prior_sd(size);
  for (Eigen::Index k = 0; k < size; ++k) {
    prior_sd[k] = functions[static_cast<std::size_t>(k)].prior_sd;
  }
  const auto sd = prior_sd.asDiagonal();
  const Eigen::MatrixXd information = sd * system.information * sd;
  const Eigen::LLT<Eigen::MatrixXd> llt(Symmetrized(information) +
                                        Eigen::MatrixXd::Identity(size, size));
  const Eigen::VectorXd amplitudes = sd * llt.solve(sd * system.gradient);
  if (llt.info() != Eigen::Success || !amplitudes.allFinite()) return;
  const Eigen::MatrixXd steps = system.mode_steps * sd;
  build->distortion_root = llt.matrixL().solve(steps.transpose()).transpose();
  for (const RunIndex r : build->runs.indices()) {
    auto& coefficients = build->runs[r].distortion.coefficients;
    coefficients(kRange, SensorDistortion::kR) = -amplitudes.dot(growth);
    for (Eigen::Index k = 0; k < size; ++k) {
      const ErrorFunction& function = functions[static_cast<std::size_t>(k)];
      if (function.vehicle != vehicles[r]) continue;
      coefficients.row(function.row) += amplitudes[k] * function.coefficients.transpose();
    }
  }
}

}  // namespace

void SolveWithDistortions(const MapperOptions& options, BuildState* build, GraphSolver* solver) {
  DropDistortions(build);
  if (options.calibrate && options.distortion_share > 0.0) {
    const Graph graph = SolveContinuous(options, build, solver);
    const std::unique_ptr<GraphPosterior> posterior = solver->Linearize(graph);
    if (posterior) SetDistortions(options, graph, *posterior, build);
  }
  SolveContinuous(options, build, solver);
}

void SolveWithDistortions(const MapperOptions& options, BuildState* build) {
  GraphSolver solver;
  SolveWithDistortions(options, build, &solver);
}

void DropDistortions(BuildState* build) {
  for (BuildRun& run : build->runs) run.distortion = {};
  build->distortion_root = {};
}

}  // namespace shiftmap
