// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/distortion_calibration.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
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

using ObservationsByVehicle = std::map<std::size_t, std::vector<ObservationIndex>>;

// One of a vehicle's sensor, of its range or its bearing.
struct ErrorFunction {
  std::optional<std::size_t> vehicle;  // Of all alike if none.
  int row = kRange;
  Monomials coefficients;  // Mean square 1 over the vehicle's observations.
  double prior_sd = 0.0;   // [m] or [rad]
};

// An observation where the solved graph expects it in the field of view. At the measured place, an
// error would be a function of its own noise, and the product of noise with itself has a mean.
struct ExpectedSighting {
  Monomials monomials;
  Eigen::Matrix2d by_polar;  // Standardized residual by (range, bearing), times the root of weight.
  bool outlier = false;      // It may be expected anywhere.
};
using ExpectedSightings = IndexedVector<ObservationIndex, ExpectedSighting>;

ExpectedSightings ExpectSightings(const Graph& graph) {
  const double gate = ChiSquareQuantile(kInlierProbability, 2);
  const IndexedVector<RunIndex, RobustLoss> losses = LossesOf(graph);
  ExpectedSightings sightings;
  for (const GraphObservation& item : graph.observations) {
    const GraphRun& run = graph.runs[item.run];
    const ObservationResidual residual(item);
    const Se2& pose = run.poses[item.frame];
    const Eigen::Vector2d& p = graph.modes[item.mode];
    const double squared =
        residual.ResidualAt(pose, pose.Rotation(), p, run.sensor_bias).squaredNorm();
    Observation expected = item.observation;
    expected.z -=
        LinearizeBiased(item.observation, pose, p, run.sensor_bias, item.mean_squared_bearing).nu;
    sightings.push_back({SensorDistortion::MonomialsOf(expected),
                         std::sqrt(losses[item.run].Curvature(squared)) *
                             residual.Whitened(SensorDistortion::DzDPolar(expected)),
                         squared > gate});
  }
  return sightings;
}

// Monomials that differ from those before by less than this part, squared, are left out.
constexpr double kLeastPart = 1e-6;

// The errors that SensorBias has: scale and curvature of ranges, offset of bearings.
std::vector<int> OfSensorBias(int row) {
  if (row == kBearing) return {SensorDistortion::kOne};
  return {SensorDistortion::kR, SensorDistortion::kRBB};
}

// Polynomials of second degree that are orthonormal over observations, and orthogonal to the errors
// in SensorBias, by Gram and Schmidt.
std::vector<Monomials> OrthonormalOver(const ExpectedSightings& sightings,
                                       const std::vector<ObservationIndex>& observations,
                                       int row) {
  Eigen::Matrix<double, SensorDistortion::kMonomials, SensorDistortion::kMonomials> products =
      decltype(products)::Zero();
  for (const ObservationIndex i : observations) {
    if (sightings[i].outlier) continue;
    const Monomials& m = sightings[i].monomials;
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
                     const ExpectedSightings& sightings,
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
    const std::vector<Monomials> orthonormal = OrthonormalOver(sightings, observations, row);
    const auto count = static_cast<double>(orthonormal.size());
    for (const Monomials& function : orthonormal) {
      functions->push_back(
          {vehicle, row, function, options.distortion_share * sd[row] / std::sqrt(count)});
    }
  }
}

// The functions as errors on standardized residuals.
class DistortedResiduals {
 public:
  // @param sightings  Of the graph.
  // @param functions  Those of each vehicle, and last one of all.
  // @param vehicles   Of the runs of the graph. The others must outlive this.
  DistortedResiduals(const Graph& graph,
                     const ExpectedSightings& sightings,
                     const std::vector<ErrorFunction>& functions,
                     const IndexedVector<RunIndex, std::size_t>& vehicles)
      : graph_(graph), sightings_(sightings), functions_(functions) {
    errors_.amplitudes = std::ssize(functions);
    for (const RunIndex r : graph.runs.indices()) {
      std::vector<Eigen::Index>& of_run = errors_.of_run.emplace_back();
      for (std::size_t k = 0; k < functions.size(); ++k) {
        const std::optional<std::size_t> vehicle = functions[k].vehicle;
        if (!vehicle || vehicle == vehicles[r]) of_run.push_back(static_cast<Eigen::Index>(k));
      }
    }
    errors_.of_observation = [this](ObservationIndex i) { return At(i); };
  }

  DistortedResiduals(const DistortedResiduals&) = delete;
  DistortedResiduals& operator=(const DistortedResiduals&) = delete;

  const LinearErrors& errors() const { return errors_; }

  // Φᵀ e.
  Eigen::VectorXd Gradient() const {
    const GraphResiduals present = PresentResiduals(graph_);
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(errors_.amplitudes);
    for (const ObservationIndex i : graph_.observations.indices()) {
      gradient(errors_.of_run[graph_.observations[i].run]) +=
          At(i).transpose() * present.observations.col(i.value());
    }
    return gradient;
  }

 private:
  Eigen::Matrix2Xd At(ObservationIndex i) const {
    const std::vector<Eigen::Index>& of_run = errors_.of_run[graph_.observations[i].run];
    Eigen::Matrix2Xd columns(2, std::ssize(of_run));
    for (std::size_t k = 0; k < of_run.size(); ++k) {
      const ErrorFunction& function = functions_[static_cast<std::size_t>(of_run[k])];
      columns.col(static_cast<Eigen::Index>(k)) =
          sightings_[i].by_polar.col(function.row) *
          function.coefficients.dot(sightings_[i].monomials);
    }
    return columns;
  }

  const Graph& graph_;
  const ExpectedSightings& sightings_;
  const std::vector<ErrorFunction>& functions_;
  LinearErrors errors_;
};

// The normal equations of the amplitudes of functions, with all of a graph eliminated.
struct AmplitudeSystem {
  Eigen::MatrixXd information;  // Φᵀ (I - J H⁻¹ Jᵀ) Φ
  Eigen::VectorXd gradient;     // Φᵀ e
  Eigen::MatrixXd mode_steps;   // H⁻¹ Jᵀ Φ
};

AmplitudeSystem EliminateGraph(const GraphPosterior& posterior,
                               const DistortedResiduals& distorted) {
  GraphPosterior::ErrorFit fit = posterior.FitErrors(distorted.errors());
  return {std::move(fit.information), distorted.Gradient(), std::move(fit.mode_steps)};
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
  }
  return observations;
}

// Those of all vehicles, and last the scale of all ranges.
std::vector<ErrorFunction> FunctionsOf(const MapperOptions& options,
                                       const SensorCalibration& sensor,
                                       const Graph& graph,
                                       const ExpectedSightings& sightings,
                                       const ObservationsByVehicle& observations) {
  std::vector<ErrorFunction> functions;
  for (const auto& [vehicle, of_vehicle] : observations) {
    AppendFunctions(options, sensor, graph, sightings, of_vehicle, vehicle, &functions);
  }
  functions.push_back({std::nullopt, kRange, Monomials::Unit(SensorDistortion::kR), 0.0});
  return functions;
}

bool HasDistortions(const MapperOptions& options) {
  return options.calibrate && options.distortion_share > 0.0;
}

}  // namespace

bool EstimateDistortions(const MapperOptions& options,
                         const Graph& graph,
                         const GraphPosterior& posterior,
                         BuildState* build) {
  if (!HasDistortions(options)) return false;
  const IndexedVector<RunIndex, std::size_t> vehicles = VehicleOfRun(*build);
  const ExpectedSightings sightings = ExpectSightings(graph);
  const std::vector<ErrorFunction> functions =
      FunctionsOf(options, build->sensor, graph, sightings, GroupByVehicle(graph, vehicles));
  const AmplitudeSystem all =
      EliminateGraph(posterior, DistortedResiduals(graph, sightings, functions, vehicles));
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
  if (llt.info() != Eigen::Success || !amplitudes.allFinite()) return false;
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
  return true;
}

void SolveWithDistortions(const MapperOptions& options, BuildState* build, GraphSolver* solver) {
  DropDistortions(build);
  if (HasDistortions(options)) {
    const Graph graph = SolveContinuous(options, build, solver);
    const std::unique_ptr<GraphPosterior> posterior = solver->Linearize(graph);
    if (posterior) EstimateDistortions(options, graph, *posterior, build);
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
