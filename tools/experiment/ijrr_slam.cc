// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_slam.h"

#include <cmath>
#include <limits>
#include <utility>

#include "proto/core/check.h"
#include "tools/experiment/incremental/incremental_mapper.h"

namespace shiftmap {
namespace {

// Of the first pose: the robot starts at the origin. [m], [rad]
constexpr double kStartSd = 1e-6;

// All modes are known: what is seen is of the nearest of them, however far it is.
constexpr double kOpenGate = 1.0 - 1e-12;

IncrementalOptions OptionsOf(const IjrrSelectorsOptions& options, const SelectorOptions& selector) {
  IncrementalOptions result;
  result.selector = selector;
  result.gate_probability = kOpenGate;
  result.min_sightings = std::numeric_limits<int>::max();
  result.merge_probability = 0.0;
  result.change_probability = options.change_probability;
  result.sensor.max_range_m = 1e3;
  result.sensor.max_bearing_rad = 2.0 * M_PI;
  result.sensor.detection_probability = options.detection_probability;
  result.smoother.loss_scale = 1e6;  // Least squares, as in the paper.
  result.max_alternations = options.max_alternations;
  return result;
}

IncrementalPrior PriorOf(const IjrrSelectorsOptions& options, const IjrrSlamProblem& problem) {
  const auto size = 2 * std::ssize(problem.prior);
  IncrementalPrior prior;
  prior.groups = 1;
  prior.group.assign(problem.prior.size(), 0);
  prior.mean.resize(size);
  for (std::size_t k = 0; k < problem.prior.size(); ++k) {
    prior.mean.segment<2>(static_cast<Eigen::Index>(2 * k)) = problem.prior[k];
  }
  prior.cov = Eigen::MatrixXd::Identity(size, size) * (options.prior_sd_m * options.prior_sd_m);
  if (options.known_start) prior.choice_before = {0};
  return prior;
}

IncrementalFrame FrameOf(const IjrrSelectorsOptions& options,
                         const IjrrSlamProblem& problem,
                         std::size_t t) {
  IncrementalFrame frame;
  frame.stamp = StampFromSeconds(static_cast<double>(t));
  frame.motion.cov = options.process_sd.cwiseAbs2().asDiagonal();
  Observation observation;
  observation.kind = Observation::Kind::kCartesian;
  observation.z = problem.observations[t];
  observation.cov_z = Eigen::Matrix2d::Identity() * problem.noise_m2;
  frame.observations.push_back({0, std::move(observation)});
  return frame;
}

}  // namespace

IjrrSlamProblem SimulateIjrrSlam(const IjrrSelectorsOptions& options,
                                 double noise_m2,
                                 std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const auto draw = [&] { return Eigen::Vector2d(normal(random), normal(random)); };
  IjrrSlamProblem problem;
  problem.noise_m2 = noise_m2;
  for (const Eigen::Vector2d& place : options.places) {
    problem.prior.push_back(place + options.prior_sd_m * draw());
  }
  Se2 T_map_vehicle;
  for (std::size_t k = 0; k < options.places.size(); ++k) {
    for (int i = 0; i < options.observations_per_place; ++i) {
      if (!problem.truth.empty()) {
        const Eigen::Vector2d shift = options.process_sd.head<2>().cwiseProduct(draw());
        const double turn = options.process_sd.z() * normal(random);
        T_map_vehicle = T_map_vehicle * Se2::Exp({shift.x(), shift.y(), turn});
      }
      problem.true_poses.push_back(T_map_vehicle);
      problem.truth.push_back(static_cast<int>(k));
      problem.observations.push_back(T_map_vehicle.Inverse() * options.places[k] +
                                     std::sqrt(noise_m2) * draw());
    }
  }
  return problem;
}

IjrrSlamResult SolveIjrrSlam(const IjrrSelectorsOptions& options,
                             const SelectorOptions& selector_options,
                             const IjrrSlamProblem& problem) {
  const PoseWithCovariance start{Se2(), Eigen::Matrix3d::Identity() * (kStartSd * kStartSd)};
  StatusOr<IncrementalMapper> mapper = IncrementalMapper::Create(
      OptionsOf(options, selector_options), PriorOf(options, problem), start);
  SHIFTMAP_CHECK(mapper.ok(), "{}", Message(mapper.status()));
  IjrrSlamResult result;
  for (std::size_t t = 0; t < problem.observations.size(); ++t) {
    const StatusOr<IncrementalStep> step = mapper->AddFrame(FrameOf(options, problem, t));
    SHIFTMAP_CHECK(step.ok(), "{}", Message(step.status()));
    result.alternations += step->alternations;
  }
  result.states = mapper->Choices();
  const auto last = static_cast<std::size_t>(problem.truth.back());
  const Eigen::Vector2d robot =
      mapper->T_map_vehicle().translation() - problem.true_poses.back().translation();
  result.squared_error_m2 =
      robot.squaredNorm() + (mapper->Modes(0)[last] - options.places[last]).squaredNorm();
  return result;
}

}  // namespace shiftmap
