// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/unconstrained_runs.h"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "mapper/covariance/mode_covariance.h"
#include "mapper/modes/mode_merging.h"

namespace shiftmap {
namespace {

// Which runs have which modes, by flat index.
class Ties {
 public:
  explicit Ties(const BuildState& build)
      : modes_(build.runs.size()),
        runs_(static_cast<std::size_t>(FlatModes(build).count)),
        priors_(build.priors) {
    const FlatModes flat(build);
    for (std::size_t r = 0; r < build.runs.size(); ++r) {
      for (const auto& [group, mode] : ModesOf(build.runs[r])) {
        modes_[r].push_back(flat.Index(group, mode));
        runs_[static_cast<std::size_t>(modes_[r].back())].push_back(r);
      }
    }
  }

  // Per run, how many modes no other run has.
  std::vector<int> OwnModes() const {
    std::vector<int> own(modes_.size());
    for (const std::vector<std::size_t>& runs : runs_) {
      if (runs.size() == 1) ++own[runs.front()];
    }
    return own;
  }

  // Runs that are tied to the prior map, or to one of them where there is none.
  std::vector<bool> TiedTo(std::size_t first) const {
    std::vector<bool> tied(modes_.size());
    std::vector<int> count(modes_.size());
    std::vector<bool> known(runs_.size());
    std::vector<std::size_t> open;
    const auto learn = [&](int mode) {
      const auto m = static_cast<std::size_t>(mode);
      if (known[m]) return;
      known[m] = true;
      for (const std::size_t run : runs_[m]) {
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
      for (const int mode : prior.modes) learn(mode);
    }
    while (!open.empty()) {
      const std::size_t run = open.back();
      open.pop_back();
      for (const int mode : modes_[run]) learn(mode);
    }
    return tied;
  }

 private:
  std::vector<std::vector<int>> modes_;         // Per run.
  std::vector<std::vector<std::size_t>> runs_;  // Per mode.
  const std::vector<GraphPrior>& priors_;
};

// The most runs that are tied to each other, or to the prior map.
std::vector<bool> MostTied(const BuildState& build) {
  const Ties ties(build);
  std::vector<bool> most(build.runs.size());
  std::vector<bool> tried(build.runs.size());
  for (std::size_t r = 0; r < build.runs.size(); ++r) {
    if (tried[r]) continue;
    const std::vector<bool> tied = ties.TiedTo(r);
    if (std::count(tied.begin(), tied.end(), true) > std::count(most.begin(), most.end(), true)) {
      most = tied;
    }
    if (!build.priors.empty()) break;
    for (std::size_t i = 0; i < tied.size(); ++i) tried[i] = tried[i] || tied[i];
  }
  return most;
}

// Leaves the others out for `reason`, and the modes that only they have.
void KeepRuns(const std::vector<bool>& keep, const char* reason, BuildState* build) {
  std::vector<BuildRun> kept;
  for (std::size_t r = 0; r < keep.size(); ++r) {
    if (keep[r]) {
      kept.push_back(std::move(build->runs[r]));
    } else {
      build->left_out.push_back({build->runs[r].data->name, reason});
    }
  }
  build->runs = std::move(kept);
  DropUnusedModes(build);
}

}  // namespace

int RemoveUnconstrainedRuns(BuildState* build) {
  if (build->runs.size() == 1 && build->priors.empty()) return 0;
  const std::vector<bool> tied = MostTied(*build);
  const auto loose = static_cast<int>(std::count(tied.begin(), tied.end(), false));
  if (loose == 0) return 0;
  KeepRuns(tied, kUnconstrainedReason, build);
  return loose;
}

int RemoveRunsOfOutliers(BuildState* build) {
  std::vector<bool> keep;
  for (const BuildRun& run : build->runs) keep.push_back(!ModesOf(run).empty());
  const auto empty = static_cast<int>(std::count(keep.begin(), keep.end(), false));
  if (empty > 0) KeepRuns(keep, kOutliersReason, build);
  return empty;
}

bool RemoveRunWithMostModes(BuildState* build) {
  if (build->runs.size() < 2) return false;
  const std::vector<int> own = Ties(*build).OwnModes();
  std::vector<bool> keep(build->runs.size(), true);
  keep[static_cast<std::size_t>(std::max_element(own.begin(), own.end()) - own.begin())] = false;
  KeepRuns(keep, kTooLargeReason, build);
  return true;
}

int RemoveUndeterminedRuns(const MapperOptions& options, BuildState* build) {
  std::vector<bool> determined;
  for (const BuildRun& run : build->runs) {
    BuildState alone = *build;
    alone.runs = {run};
    DropUnusedModes(&alone);
    determined.push_back(LinearizeForMap(MakeGraph(options, &alone)) != nullptr);
  }
  KeepRuns(determined, kUndeterminedReason, build);
  return static_cast<int>(std::count(determined.begin(), determined.end(), false));
}

}  // namespace shiftmap
