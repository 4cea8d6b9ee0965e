// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/schur_system.h"

#include <cmath>
#include <numeric>
#include <utility>

#include "mapper/parallel.h"

namespace shiftmap {

SchurSystem::SchurSystem(const Graph& graph,
                         std::unique_ptr<ReducedSystem> reduced,
                         const std::vector<std::vector<ModeIndex>>& required_sets)
    : graph_(graph), segments_(graph), linearizer_(graph), required_sets_(required_sets) {
  if (reduced && reduced->size() == segments_.size()) {
    reduced_ = std::move(reduced);
  } else {
    reduced_ = std::make_unique<ReducedSystem>(segments_.size(), graph.threads);
  }
}

bool SchurSystem::Linearize(LossWeighting weighting, double damping) {
  struct Eliminated {
    std::optional<SegmentFactor> factor;
    Eigen::MatrixXd C;
    Eigen::VectorXd c;
    double cost = 0.0;
  };
  const std::vector<GraphSegment>& segments = segments_.all();
  factors_.clear();
  reduced_->Clear();
  cost_ = PriorCost();
  AddPriors();
  AddRequiredSets();
  std::vector<Eliminated> eliminated(segments.size());
  ForEachIndex(segments.size(), graph_.threads, [&](std::size_t i) {
    const GraphSegment& segment = segments[i];
    SegmentSystem system(segment.poses(), static_cast<int>(segment.boundary.size()));
    Eliminated& result = eliminated[i];
    result.cost = linearizer_.Linearize(segment, weighting, &system);
    if (damping > 0.0) system.Damp(damping);
    result.factor = SegmentFactor::Of(&system);
    result.C = std::move(system.C);
    result.c = std::move(system.c);
  });
  for (std::size_t i = 0; i < segments.size(); ++i) {
    if (!eliminated[i].factor) return false;
    factors_.push_back(*std::move(eliminated[i].factor));
    cost_ += eliminated[i].cost;
    reduced_->Add(segments[i].boundary, std::move(eliminated[i].C), eliminated[i].c);
  }
  return std::isfinite(cost_);
}

double SchurSystem::PresentCost() const {
  std::vector<double> costs(segments_.all().size());
  ForEachIndex(costs.size(), graph_.threads, [&](std::size_t i) {
    costs[i] = linearizer_.Cost(segments_.all()[i]);
  });
  return std::accumulate(costs.begin(), costs.end(), PriorCost());
}

double SchurSystem::PriorCost() const {
  double cost = 0.0;
  for (const GraphRun& run : graph_.runs) {
    const Eigen::Vector3d difference = run.correction - run.correction_prior_mean;
    cost += 0.5 * difference.cwiseQuotient(run.correction_prior_sd).squaredNorm() +
            0.5 * run.sensor_bias.cwiseQuotient(run.sensor_bias_sd).squaredNorm();
  }
  for (const GraphPrior& prior : graph_.priors) {
    cost += 0.5 * (prior.sqrt_information * PriorDifference(prior)).squaredNorm();
  }
  return cost;
}

Eigen::VectorXd SchurSystem::PriorDifference(const GraphPrior& prior) const {
  Eigen::VectorXd difference(prior.mean.size());
  for (std::size_t i = 0; i < prior.modes.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(2 * i);
    difference.segment<2>(at) = graph_.modes[prior.modes[i]] - prior.mean.segment<2>(at);
  }
  return difference;
}

void SchurSystem::AddPriors() {
  for (const RunIndex r : graph_.runs.indices()) {
    const GraphRun& run = graph_.runs[r];
    Eigen::Vector<double, kRunCalibration> information;
    information << run.correction_prior_sd.cwiseAbs2().cwiseInverse(),
        run.sensor_bias_sd.cwiseAbs2().cwiseInverse();
    Eigen::Vector<double, kRunCalibration> difference;
    difference << run.correction - run.correction_prior_mean, run.sensor_bias;
    std::vector<int> index;
    for (int i = 0; i < kRunCalibration; ++i) {
      index.push_back(segments_.first_calibration() + kRunCalibration * r.value() + i);
    }
    reduced_->Add(index, information.asDiagonal(), -information.cwiseProduct(difference));
  }
  for (const GraphPrior& prior : graph_.priors) {
    reduced_->Add(segments_.UnknownsOf(prior.modes),
                  prior.information,
                  -(prior.information * PriorDifference(prior)));
  }
}

// Terms of zeros: they have entries in the factor.
void SchurSystem::AddRequiredSets() {
  for (const std::vector<ModeIndex>& modes : required_sets_) {
    const std::vector<int> unknowns = segments_.UnknownsOf(modes);
    const Eigen::Index size = std::ssize(unknowns);
    reduced_->Add(unknowns, Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size));
  }
}

std::optional<SchurSystem::Step> SchurSystem::Solve() {
  const std::optional<Eigen::VectorXd> reduced = reduced_->Solve();
  if (!reduced) return std::nullopt;
  double decrease = reduced_->right_side().dot(*reduced);
  for (const SegmentFactor& factor : factors_) decrease += factor.Decrease();
  return Step{Complete(*reduced,
                       [&](std::size_t i, const Eigen::VectorXd& boundary) {
                         return factors_[i].Solve(boundary);
                       }),
              0.5 * decrease};
}

GraphStep SchurSystem::Complete(const Eigen::VectorXd& reduced, const Inside& inside) const {
  GraphStep step;
  for (const GraphRun& run : graph_.runs) {
    step.poses.emplace_back(Eigen::VectorXd::Zero(3 * run.poses.end_index()));
  }
  for (std::size_t s = 0; s < segments_.all().size(); ++s) {
    const GraphSegment& segment = segments_.all()[s];
    Eigen::VectorXd boundary(std::ssize(segment.boundary));
    for (std::size_t i = 0; i < segment.boundary.size(); ++i) {
      const int row = segment.boundary[i];
      boundary[static_cast<Eigen::Index>(i)] = row < 0 ? 0.0 : reduced[row];
    }
    Eigen::VectorXd& poses = step.poses[segment.run];
    poses.segment<3>(3 * segment.first) = boundary.segment<3>(kSeparatorBefore);
    if (segment.last > segment.first) {
      poses.segment<3>(3 * segment.last) = boundary.segment<3>(kSeparatorAfter);
    }
    const int count = segment.poses();
    if (count == 0) continue;
    poses.segment(3 * (segment.first + 1), Eigen::Index{3} * count) = inside(s, boundary);
  }
  for (const RunIndex r : graph_.runs.indices()) {
    step.calibrations.emplace_back(
        reduced.segment<kRunCalibration>(segments_.first_calibration() + kRunCalibration * r));
  }
  step.modes = reduced.tail(2 * graph_.modes.end_index());
  return step;
}

}  // namespace shiftmap
