// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/visit_scatter.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <utility>
#include <vector>

#include "mapper/modes/visit_density.h"
#include "mapper/parallel.h"
#include "mapper/state/sightings.h"
#include "mapper/state/visit_ref.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Where a visit puts its landmark.
struct Deviation {
  Eigen::Vector2d from_mode;
  Eigen::Matrix2d cov;
};

struct ModeVisits {
  ModeIndex mode;
  std::vector<Deviation> deviations;

  int dof() const { return 2 * (static_cast<int>(deviations.size()) - 1); }
};

// Nothing of a visit that agrees nowhere, or on a place that no mode here explains.
std::optional<Deviation> DeviationOf(const ModeOptions& options,
                                     const BuildState& build,
                                     const VisitRef& ref,
                                     const Eigen::Vector2d& p_mode) {
  const BuildRun& run = build.runs[ref.run];
  const MappingVisit& visit = VisitOf(build, ref);
  if (!MakesMode(options, visit)) return std::nullopt;
  const VisitCluster cluster = ClusterOf(run, visit, options.cluster_radius_m);
  if (cluster.count < options.min_sightings) return std::nullopt;
  if ((cluster.centre - p_mode).norm() > 2.0 * options.cluster_radius_m) return std::nullopt;
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
  Eigen::Vector2d weighted = Eigen::Vector2d::Zero();
  for (const SeenPlace& seen : SeenPlaces(build, run, visit)) {
    if ((seen.position - cluster.centre).norm() > options.cluster_radius_m) continue;
    const Eigen::Matrix2d of_sighting = seen.cov.inverse();
    if (!of_sighting.allFinite()) continue;
    information += of_sighting;
    weighted += of_sighting * (seen.position - p_mode);
  }
  const Eigen::Matrix2d cov = information.inverse();
  if (!cov.allFinite()) return std::nullopt;
  return Deviation{cov * weighted, cov};
}

std::vector<ModeVisits> ModesOfGroup(const ModeOptions& options,
                                     const BuildState& build,
                                     const FlatModes& flat,
                                     const std::vector<VisitRef>& visits,
                                     GroupIndex group) {
  std::vector<ModeVisits> modes;
  for (const GroupModeIndex k : build.modes[group].indices()) {
    ModeVisits of_mode{flat.Index(group, k), {}};
    for (const VisitRef& ref : visits) {
      if (AssignmentOf(build, ref) != k) continue;
      const auto deviation = DeviationOf(options, build, ref, build.modes[group][k].p_map_landmark);
      if (deviation) of_mode.deviations.push_back(*deviation);
    }
    if (of_mode.deviations.size() > 1) modes.push_back(std::move(of_mode));
  }
  return modes;
}

Eigen::Matrix2d WithShared(const Eigen::Matrix2d& cov, double shared) {
  return cov + shared * Eigen::Matrix2d::Identity();
}

// About their weighted mean: χ² of dof(), also where a prior map holds the mode.
double SumOfSquares(const ModeVisits& visits, double shared) {
  double sum = 0.0;
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
  Eigen::Vector2d weighted = Eigen::Vector2d::Zero();
  for (const Deviation& deviation : visits.deviations) {
    const Eigen::Matrix2d weight = WithShared(deviation.cov, shared).inverse();
    sum += deviation.from_mode.dot(weight * deviation.from_mode);
    information += weight;
    weighted += weight * deviation.from_mode;
  }
  return sum - weighted.dot(information.inverse() * weighted);
}

// Whether the median mode scatters by no more than the median of its χ² (Wilson, Hilferty 1931).
bool Explains(double shared, const std::vector<ModeVisits>& modes) {
  std::vector<double> ratios;
  for (const ModeVisits& visits : modes) {
    const double dof = visits.dof();
    ratios.push_back(SumOfSquares(visits, shared) / (dof * std::pow(1.0 - 2.0 / (9.0 * dof), 3)));
  }
  const auto median = ratios.begin() + static_cast<std::ptrdiff_t>((ratios.size() - 1) / 2);
  std::nth_element(ratios.begin(), median, ratios.end());
  return *median <= 1.0;
}

// What the visits of most modes have in common beside the noise of their sightings. Of a few modes
// one that scatters would be the measure of itself: they tell nothing. [m²]
double SharedVariance(const ModeOptions& options, const std::vector<ModeVisits>& modes) {
  constexpr int kHalvings = 20;
  constexpr std::size_t kMinModes = 4;
  if (modes.size() < kMinModes) return options.score_position_sd_m * options.score_position_sd_m;
  if (Explains(0.0, modes)) return 0.0;
  double low = 0.0;
  double high = 1.0;  // Visits are within a metre of their modes.
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    (Explains(middle, modes) ? high : low) = middle;
  }
  return high;
}

// The mean square of a mode's deviations beyond their covariances.
Eigen::Matrix2d Excess(const ModeVisits& visits, double shared) {
  Eigen::Matrix2d sum = Eigen::Matrix2d::Zero();
  for (const Deviation& deviation : visits.deviations) {
    sum +=
        deviation.from_mode * deviation.from_mode.transpose() - WithShared(deviation.cov, shared);
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver(
      Symmetrized(sum / static_cast<double>(visits.deviations.size())));
  return solver.eigenvectors() * solver.eigenvalues().cwiseMax(0.0).asDiagonal() *
         solver.eigenvectors().transpose();
}

std::vector<ModeVisits> VisitsOfModes(const ModeOptions& options,
                                      const BuildState& build,
                                      int threads) {
  const FlatModes flat(build);
  const auto by_group = VisitsByGroup(build);
  std::vector<std::vector<ModeVisits>> of_groups(by_group.size());
  ForEachIndex(by_group.size(), threads, [&](std::size_t i) {
    const GroupIndex group(i);
    of_groups[i] = ModesOfGroup(options, build, flat, by_group[group], group);
  });
  std::vector<ModeVisits> modes;
  for (std::vector<ModeVisits>& of_group : of_groups) {
    std::move(of_group.begin(), of_group.end(), std::back_inserter(modes));
  }
  return modes;
}

}  // namespace

double SharedVisitVariance(const ModeOptions& options, const BuildState& build, int threads) {
  return SharedVariance(options, VisitsOfModes(options, build, threads));
}

std::map<ModeIndex, Eigen::Matrix2d> VisitScatter(const ModeOptions& options,
                                                  const BuildState& build,
                                                  int threads) {
  const std::vector<ModeVisits> modes = VisitsOfModes(options, build, threads);
  const double shared = SharedVariance(options, modes);
  std::map<ModeIndex, Eigen::Matrix2d> excesses;
  for (const ModeVisits& visits : modes) {
    const double squares = SumOfSquares(visits, shared);
    if (ChiSquareTail(squares, visits.dof()) >= 1.0 - options.merge_probability) continue;
    excesses[visits.mode] = Excess(visits, shared);
  }
  return excesses;
}

}  // namespace shiftmap
