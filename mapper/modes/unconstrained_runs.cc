// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/unconstrained_runs.h"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "mapper/calibration/implausible_calibration.h"
#include "mapper/covariance/mode_covariance.h"
#include "mapper/modes/mode_merging.h"

namespace shiftmap {
namespace {

using RunFlags = IndexedVector<RunIndex, bool>;

// Which runs have which modes.
class Ties {
 public:
  explicit Ties(const BuildState& build)
      : modes_(build.runs.size()), runs_(FlatModes(build).count()), priors_(build.priors) {
    const FlatModes flat(build);
    for (const RunIndex r : build.runs.indices()) {
      modes_[r] = flat.Of(build.runs[r]);
      for (const ModeIndex mode : modes_[r]) runs_[mode].push_back(r);
    }
  }

  // Per run, how many modes no other run has.
  std::vector<int> OwnModes() const {
    IndexedVector<RunIndex, int> own(modes_.size());
    for (const std::vector<RunIndex>& runs : runs_) {
      if (runs.size() == 1) ++own[runs.front()];
    }
    return own;
  }

  // Runs that are tied to the prior map, or to one of them where there is none.
  RunFlags TiedTo(RunIndex first) const {
    RunFlags tied(modes_.size());
    IndexedVector<RunIndex, int> count(modes_.size());
    IndexedVector<ModeIndex, bool> known(runs_.size());
    std::vector<RunIndex> open;
    const auto learn = [&](ModeIndex mode) {
      if (known[mode]) return;
      known[mode] = true;
      for (const RunIndex run : runs_[mode]) {
        if (++count[run] != kMinTyingModes || tied[run]) continue;
        tied[run] = true;
        open.push_back(run);
      }
    };
    if (priors_.empty() && !modes_[first].empty()) {
      tied[first] = true;
      open.push_back(first);
    }
    for (const GraphPrior& prior : priors_) {
      for (const ModeIndex mode : prior.modes) learn(mode);
    }
    while (!open.empty()) {
      const RunIndex run = open.back();
      open.pop_back();
      for (const ModeIndex mode : modes_[run]) learn(mode);
    }
    return tied;
  }

 private:
  IndexedVector<RunIndex, std::vector<ModeIndex>> modes_;
  IndexedVector<ModeIndex, std::vector<RunIndex>> runs_;
  const std::vector<GraphPrior>& priors_;
};

// The most runs that are tied to each other, or to the prior map.
RunFlags MostTied(const BuildState& build) {
  const Ties ties(build);
  RunFlags most(build.runs.size());
  RunFlags tried(build.runs.size());
  for (const RunIndex r : build.runs.indices()) {
    if (tried[r]) continue;
    const RunFlags tied = ties.TiedTo(r);
    if (std::count(tied.begin(), tied.end(), true) > std::count(most.begin(), most.end(), true)) {
      most = tied;
    }
    if (!build.priors.empty()) break;
    for (const RunIndex i : tied.indices()) tried[i] = tried[i] || tied[i];
  }
  return most;
}

// Why each run is left out; empty: it stays.
using Reasons = IndexedVector<RunIndex, std::string>;

// Leaves runs out, and the modes that only they have. Returns how many.
int LeaveOut(const Reasons& reasons, BuildState* build) {
  std::vector<BuildRun> kept;
  for (const RunIndex r : reasons.indices()) {
    if (reasons[r].empty()) {
      kept.push_back(std::move(build->runs[r]));
    } else {
      build->left_out.push_back({build->runs[r].data->name, reasons[r]});
    }
  }
  const auto left = static_cast<int>(reasons.size() - kept.size());
  build->runs = std::move(kept);
  if (left > 0) DropUnusedModes(build);
  return left;
}

// All but some for one reason.
int KeepRuns(const RunFlags& keep, const char* reason, BuildState* build) {
  Reasons reasons;
  for (const bool kept : keep) reasons.push_back(kept ? "" : reason);
  return LeaveOut(reasons, build);
}

}  // namespace

int RemoveUnconstrainedRuns(BuildState* build) {
  if (build->runs.size() == 1 && build->priors.empty()) return 0;
  return KeepRuns(MostTied(*build), kUnconstrainedReason, build);
}

int RemoveRunsOfOutliers(BuildState* build) {
  RunFlags keep;
  for (const BuildRun& run : build->runs) keep.push_back(!ModesOf(run).empty());
  return KeepRuns(keep, kOutliersReason, build);
}

Status RemoveRunsOfNoMode(BuildState* build) {
  RemoveRunsOfOutliers(build);
  return RequireRuns(!build->runs.empty() || !build->waiting.empty(), build->left_out);
}

Status RemoveUntiedRuns(BuildState* build) {
  if (!build->runs.empty()) RemoveUnconstrainedRuns(build);
  return RemoveRunsOfNoMode(build);
}

bool RemoveRunWithMostModes(BuildState* build) {
  if (build->runs.size() < 2) return false;
  const std::vector<int> own = Ties(*build).OwnModes();
  RunFlags keep(build->runs.size(), true);
  keep[RunIndex(std::max_element(own.begin(), own.end()) - own.begin())] = false;
  KeepRuns(keep, kTooLargeReason, build);
  return true;
}

int RemoveUndeterminedRuns(const MapperOptions& options, BuildState* build) {
  RunFlags determined;
  for (const BuildRun& run : build->runs) {
    BuildState alone = *build;
    alone.runs = {run};
    DropUnusedModes(&alone);
    const Graph graph = MakeGraph(options, &alone);
    const std::unique_ptr<GraphPosterior> posterior = LinearizeForMap(graph);
    determined.push_back(posterior && IsDetermined(MapCovariance(graph, *posterior, {}, {}, {})));
  }
  return KeepRuns(determined, kUndeterminedReason, build);
}

int RemoveImplausibleRuns(const PlausibilityOptions& options, BuildState* build) {
  Reasons reasons;
  for (const BuildRun& run : build->runs) {
    reasons.push_back(ImplausibleCalibration(options, run, build->sensor));
  }
  return LeaveOut(reasons, build);
}

}  // namespace shiftmap
