// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/run_variances.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "mapper/covariance/gauge.h"
#include "mapper/modes/mode_merging.h"
#include "mapper/modes/visit_scatter.h"
#include "mapper/parallel.h"
#include "mapper/run_maps/variance_factor.h"
#include "mapper/state/sightings.h"

namespace shiftmap {
namespace {

// Of a run by itself, from where it is in the build. [-]
constexpr double kCostTolerance = 1e-4;

// What a run by itself tells of its variance.
struct RunVariance {
  double factor = 1.0;
  Disagreement disagreement;  // With the build, under that factor.
};

std::optional<RunVariance> VarianceOf(const MapperOptions& options,
                                      bool is_solved,
                                      BuildState alone) {
  const IndexedVector<ModeIndex, Eigen::Vector2d> joint = ModePositions(alone);
  if (joint.size() < ShapeCovariance::kMinModes ||
      std::ssize(joint) > options.confirmation.max_modes) {
    return std::nullopt;
  }
  const Graph graph = is_solved ? MakeGraph(options, &alone) : SolveContinuous(options, &alone);
  const std::optional<ShapeCovariance> shape = ShapeCovariance::Of(graph);
  if (!shape) return std::nullopt;
  const std::optional<Eigen::VectorXd> difference = AlignedDifference(graph.modes, joint);
  if (!difference) return std::nullopt;
  const double factor = VarianceFactor(graph, *shape, options.seed);
  const double dof = static_cast<double>(difference->size()) - ShapeCovariance::kGauge;
  // Most runs are as expected: that costs little to see.
  const double squares = shape->Whiten(*difference).squaredNorm() / factor;
  if (squares <= options.disagreement.expected_mean_square * dof)
    return RunVariance{factor, {squares, dof}};
  return RunVariance{
      factor,
      DisagreementOf(options.disagreement, shape->Information() / factor, *difference, dof)};
}

// The quantile of the square of a mode's difference, of two degrees of freedom, by the mean square
// of others, of `dof` degrees of freedom, which is theirs by Fisher's distribution.
double OutlierLimit(double probability, double dof) {
  return dof * (std::pow(probability, -2.0 / dof) - 1.0);
}

}  // namespace

Disagreement DisagreementOf(const DisagreementOptions& options,
                            const Eigen::MatrixXd& of_all,
                            const Eigen::VectorXd& difference,
                            double dof) {
  Eigen::MatrixXd information = of_all;
  Eigen::VectorXd weighted = information * difference;
  Disagreement left{difference.dot(weighted), dof};
  Disagreement result = left;
  std::vector<Eigen::Index> modes;
  for (Eigen::Index m = 0; 2 * m < difference.size(); ++m) modes.push_back(m);
  const std::size_t least = std::max(static_cast<std::size_t>(options.min_modes), modes.size() / 2);
  while (modes.size() > least && left.squares > options.expected_mean_square * left.dof) {
    const auto decrease = [&](Eigen::Index m) {
      const Eigen::Vector2d of_mode = weighted.segment<2>(2 * m);
      return of_mode.dot(information.block<2, 2>(2 * m, 2 * m).inverse() * of_mode);
    };
    const auto worst = std::max_element(
        modes.begin(), modes.end(), [&](auto a, auto b) { return decrease(a) < decrease(b); });
    const double squares = decrease(*worst);
    left.squares -= squares;
    left.dof -= 2.0;
    left.outliers.emplace(*worst, Eigen::Vector2d::Zero());
    const double limit = OutlierLimit(options.outlier_probability, left.dof);
    if (squares > limit * std::max(1.0, left.squares / left.dof)) result = left;
    // The others' marginal.
    const Eigen::Index at = 2 * *worst;
    const Eigen::MatrixXd gain =
        information.middleCols<2>(at) * information.block<2, 2>(at, at).inverse();
    weighted -= gain * weighted.segment<2>(at).eval();
    information.noalias() -= gain * information.middleRows<2>(at).eval();
    modes.erase(worst);
  }
  std::vector<Eigen::Index> rows;
  for (const auto& [m, of_mode] : result.outliers) rows.insert(rows.end(), {2 * m, 2 * m + 1});
  const Eigen::VectorXd unexpected = of_all(rows, rows).llt().solve((of_all * difference)(rows));
  Eigen::Index row = 0;
  for (auto& [m, of_mode] : result.outliers) {
    of_mode = unexpected.segment<2>(row);
    row += 2;
  }
  return result;
}

namespace {

using RunVariances = IndexedVector<RunIndex, std::optional<RunVariance>>;

// Of a mode, over all that have it.
struct ModeSpread {
  int sources = 0;
  Eigen::Matrix2d squares = Eigen::Matrix2d::Zero();
};

// Modes that a run has a visit of by which it could have made them: a shorter one may be of a
// misread signature, and tells of no move.
std::set<ModeIndex> ModesMadeBy(const ModeOptions& options,
                                const FlatModes& flat,
                                const BuildRun& run) {
  std::set<ModeIndex> made;
  for (const VisitIndex v : run.data->visits.indices()) {
    const MappingVisit& visit = run.data->visits[v];
    if (!run.assignment[v] || !MakesMode(options, visit)) continue;
    made.insert(flat.Index(visit.group, *run.assignment[v]));
  }
  return made;
}

// By how much more than they tell runs differ from the prior map and each other.
MapDisagreement MapDisagreementOf(const MapperOptions& mapper,
                                  const BuildState& build,
                                  const RunVariances& variances) {
  const DisagreementOptions& options = mapper.disagreement;
  const FlatModes flat(build);
  const IndexedVector<ModeIndex, Eigen::Vector2d> positions = ModePositions(build);
  std::map<ModeIndex, ModeSpread> spreads;
  double squares = options.prior_dof;
  double dof = build.priors.empty() ? ShapeCovariance::kGauge : 0.0;
  const auto add = [&](const std::vector<ModeIndex>& modes,
                       const Disagreement& disagreement,
                       const auto& tells_of) {
    squares += disagreement.squares;
    dof += disagreement.dof;
    for (const ModeIndex mode : modes) spreads[mode].sources += tells_of(mode) ? 1 : 0;
    for (const auto& [m, of_mode] : disagreement.outliers) {
      const ModeIndex mode = modes[static_cast<std::size_t>(m)];
      if (tells_of(mode)) spreads[mode].squares += of_mode * of_mode.transpose();
    }
  };
  bool all_compared = true;
  for (const RunIndex r : variances.indices()) {
    const std::vector<ModeIndex> modes = flat.Of(build.runs[r]);
    if (variances[r]) {
      const std::set<ModeIndex> made = ModesMadeBy(mapper.modes, flat, build.runs[r]);
      add(modes, variances[r]->disagreement, [&](ModeIndex mode) { return made.contains(mode); });
    } else if (modes.size() >= ShapeCovariance::kMinModes) {
      all_compared = false;
    }
  }
  for (const GraphPrior& prior : build.priors) {
    Eigen::VectorXd difference = -prior.mean;
    for (std::size_t i = 0; i < prior.modes.size(); ++i) {
      difference.segment<2>(static_cast<Eigen::Index>(2 * i)) += positions[prior.modes[i]];
    }
    add(prior.modes,
        DisagreementOf(
            options, prior.information, difference, static_cast<double>(difference.size())),
        [](ModeIndex) { return true; });
  }
  dof -= 2.0 * static_cast<double>(spreads.size());  // What the common map takes.
  MapDisagreement result;
  // Else the map is also of what the sums do not have.
  if (all_compared)
    result.factor = std::max(1.0, squares / (options.prior_dof + std::max(0.0, dof)));
  for (const auto& [mode, spread] : spreads) {
    if (spread.squares.isZero(0.0)) continue;
    result.of_modes[mode] = spread.squares / static_cast<double>(spread.sources);
  }
  return result;
}

}  // namespace

void EstimateRunVariances(const MapperOptions& options, BuildState* build) {
  MapperOptions of_one = options;
  of_one.threads = 1;
  of_one.solver.cost_tolerance = std::max(kCostTolerance, options.solver.cost_tolerance);
  const bool is_alone = build->runs.size() == 1 && build->priors.empty();
  const FlatModes flat(*build);
  RunVariances variances(build->runs.size());
  ForEachIndex(variances.size(), options.threads, [&](std::size_t i) {
    const RunIndex r(i);
    BuildState alone = RunByItself(*build, r);
    alone.loss_reach = build->loss_reach;
    variances[r] = VarianceOf(of_one, is_alone, std::move(alone));
  });
  build->disagreement = MapDisagreementOf(options, *build, variances);
  double in_weights = 1.0;
  if (flat.count() > kMaxJointModes) {
    in_weights = std::exchange(build->disagreement.factor, 1.0);
  }
  for (const RunIndex r : variances.indices()) {
    double& factor = build->runs[r].variance_factor;
    factor = (variances[r] ? variances[r]->factor : factor) * in_weights;
  }
  // Both are of the same moves.
  for (const auto& [mode, scatter] : VisitScatter(options.modes, *build, options.threads)) {
    Eigen::Matrix2d& of_mode =
        build->disagreement.of_modes.try_emplace(mode, Eigen::Matrix2d::Zero()).first->second;
    if (scatter.trace() > of_mode.trace()) of_mode = scatter;
  }
}

}  // namespace shiftmap
