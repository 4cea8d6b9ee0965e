// SPDX-License-Identifier: Apache-2.0
#include "mapper/submaps/variance_factor.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <numeric>
#include <vector>

#include "mapper/covariance/datum.h"
#include "mapper/parallel.h"

namespace shiftmap {
namespace {

// Ten to sixty give about the same factor; more of them cost more.
constexpr int kBlocks = 20;

// A solve that starts near its minimum needs few steps.
constexpr int kSteps = 4;

// Of a problem that goes astray without one of the stretches.
constexpr double kUnknown = 1e4;

// The stretch of time of each visit that holds a mode, runs one after the other; kUnassigned of the
// others. Stretches have about the same number of visits.
std::vector<std::vector<int>> StretchesOf(const MapProblem& problem) {
  std::size_t count = 0;
  for (const BuildRun& run : problem.runs) {
    for (const int mode : run.assignment) count += mode != kUnassigned;
  }
  std::vector<std::vector<int>> stretches;
  std::size_t visit = 0;
  for (const BuildRun& run : problem.runs) {
    std::vector<int>& of_run = stretches.emplace_back();
    for (const int mode : run.assignment) {
      const bool holds = mode != kUnassigned;
      of_run.push_back(holds ? static_cast<int>(kBlocks * visit / count) : kUnassigned);
      visit += holds;
    }
  }
  return stretches;
}

// The problem without the visits of one stretch, but for those of modes that no others hold.
MapProblem Without(int stretch,
                   const std::vector<std::vector<int>>& stretches,
                   const MapProblem& problem) {
  MapProblem part = problem;
  std::map<BuildModeRef, bool> held;  // By other visits.
  const auto visit_all = [&](const auto& visit) {
    for (std::size_t r = 0; r < part.runs.size(); ++r) {
      BuildRun& run = part.runs[r];
      for (std::size_t v = 0; v < run.assignment.size(); ++v) {
        if (run.assignment[v] == kUnassigned) continue;
        const BuildModeRef mode{run.data->visits[v].group, run.assignment[v]};
        visit(mode, stretches[r][v] == stretch, &run.assignment[v]);
      }
    }
  };
  visit_all([&](const BuildModeRef& mode, bool inside, int*) {
    bool& by_others = held[mode];
    by_others = by_others || !inside;
  });
  visit_all([&](const BuildModeRef& mode, bool inside, int* assignment) {
    if (inside && held.at(mode)) *assignment = kUnassigned;
  });
  return part;
}

// Directions in which a map moves, turns and grows. (2n x 4)
Eigen::MatrixXd SimilarityDirections(const std::vector<Eigen::Vector2d>& positions) {
  Eigen::MatrixXd directions(2 * std::ssize(positions), 4);
  directions << DatumDirections(positions), OffsetsFromCentroid(positions);
  return directions;
}

}  // namespace

double VarianceFactor(const MapperOptions& options,
                      const MapProblem& problem,
                      const Eigen::MatrixXd& covariance) {
  const std::vector<Eigen::Vector2d> positions = ModePositions(problem);
  const auto dof = static_cast<double>(2 * std::ssize(positions) - 4);
  const Eigen::LLT<Eigen::MatrixXd> llt(covariance);
  if (dof <= 0.0 || llt.info() != Eigen::Success) return 1.0;
  const Eigen::MatrixXd directions = SimilarityDirections(positions);
  const Eigen::MatrixXd weighted = llt.solve(directions);
  const Eigen::LLT<Eigen::MatrixXd> of_directions(directions.transpose() * weighted);
  MapperOptions few = options;
  few.solver.max_iterations = std::min(kSteps, options.solver.max_iterations);
  few.max_integrations = 1;
  const std::vector<std::vector<int>> stretches = StretchesOf(problem);
  few.threads = 1;
  std::vector<double> squares(kBlocks);
  ForEachIndex(kBlocks, options.threads, [&](std::size_t stretch) {
    MapProblem part = Without(static_cast<int>(stretch), stretches, problem);
    SolveContinuous(few, &part);
    const std::vector<Eigen::Vector2d> moved = ModePositions(part);
    Eigen::VectorXd change(2 * std::ssize(positions));
    for (std::size_t i = 0; i < positions.size(); ++i) {
      change.segment<2>(static_cast<Eigen::Index>(2 * i)) = moved[i] - positions[i];
    }
    const Eigen::VectorXd along = weighted.transpose() * change;
    squares[stretch] = change.dot(llt.solve(change)) - along.dot(of_directions.solve(along));
  });
  const double sum = std::accumulate(squares.begin(), squares.end(), 0.0);
  if (!std::isfinite(sum)) return kUnknown;
  return std::max(1.0, sum * (kBlocks - 1.0) / kBlocks / dof);
}

}  // namespace shiftmap
