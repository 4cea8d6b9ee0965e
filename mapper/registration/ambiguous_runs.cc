// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/ambiguous_runs.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "mapper/alignment/explanation.h"
#include "mapper/modes/mode_merging.h"
#include "mapper/parallel.h"
#include "mapper/registration/misfit_runs.h"
#include "mapper/registration/run_among_others.h"

namespace shiftmap {
namespace {

// The run with stayed and moved exchanged: the landmarks that it has elsewhere are where others
// have them. Of its other landmarks those have moved that the pulled run has elsewhere.
BuildRun Exchanged(const MapperOptions& options,
                   const BuildState& build,
                   const Owners& others,
                   const std::set<GroupIndex>& elsewhere,
                   const BuildRun& run) {
  BuildRun exchanged = Pulled(options, build, others, run);
  const auto there =
      MatchVisits(options, build, others, exchanged, 0.25 * options.relocation.same_place_m);
  for (const VisitIndex v : there.indices()) {
    if (!elsewhere.contains(run.data->visits[v].group)) exchanged.assignment[v] = there[v];
  }
  return exchanged;
}

// Groups of a run that are where others have them.
std::vector<GroupIndex> StayedGroups(const Owners& others, const BuildRun& run) {
  std::vector<GroupIndex> groups;
  for (const auto& [group, mode] : ModesOf(run)) {
    if (others[group][mode] > 0 && (groups.empty() || groups.back() != group)) {
      groups.push_back(group);
    }
  }
  return groups;
}

// Beyond this, odds are no more told apart.
constexpr double kMaxLogOdds = 50.0;

// A run of which the landmarks that seem to have moved may be those that stayed.
struct AmbiguousRun {
  RunIndex run;
  double excess = 0.0;  // How much more it costs that they stayed.
  Explanations explanations;
};

std::optional<AmbiguousRun> FindAmbiguous(const MapperOptions& options,
                                          const BuildState& build,
                                          const Owners& others,
                                          RunIndex r) {
  const BuildRun& run = build.runs[r];
  if (std::ssize(ModesOf(run)) > options.confirmation.max_modes) return std::nullopt;
  if (!MayBeDeformed(options, build, others, run)) return std::nullopt;
  const std::set<GroupIndex> elsewhere = AgreementOf(options.modes, run, others).elsewhere;
  const BuildRun exchanged = Exchanged(options, build, others, elsewhere, run);
  const double excess = CostAmong(SolvedAmong(options, build, others, exchanged)) -
                        CostAmong(SolvedAmong(options, build, others, run));
  if (!(excess < kModeCost)) return std::nullopt;  // Nor if either solve diverged.
  const std::vector<GroupIndex> stayed = StayedGroups(others, run);
  const std::vector<GroupIndex> stayed_then = StayedGroups(others, exchanged);
  std::vector<GroupIndex> groups;
  std::set_union(stayed.begin(),
                 stayed.end(),
                 stayed_then.begin(),
                 stayed_then.end(),
                 std::back_inserter(groups));
  const double probability = 1.0 / (1.0 + std::exp(std::min(-excess, kMaxLogOdds)));
  return AmbiguousRun{
      r,
      excess,
      DescribeFrames({DescribeFrame({{stayed, probability}}, stayed, groups),
                      DescribeFrame({{stayed_then, 1.0 - probability}}, stayed_then, groups)})};
}

}  // namespace

bool RemoveAmbiguousRun(const MapperOptions& options,
                        BuildState* build,
                        const StepCallback& on_step) {
  MapperOptions of_one = options;
  of_one.threads = 1;
  const Owners owners = OwnersOf(*build);
  std::vector<std::optional<AmbiguousRun>> ambiguous(build->runs.size());
  ForEachIndex(build->runs.size(), options.threads, [&](std::size_t i) {
    if (on_step && !on_step(*build)) return;
    const RunIndex r(i);
    Owners others = owners;
    AddOwner(build->runs[r], -1, &others);
    ambiguous[i] = FindAmbiguous(of_one, *build, others, r);
  });
  std::optional<AmbiguousRun> worst;
  for (std::optional<AmbiguousRun>& found : ambiguous) {
    if (found && (!worst || found->excess <= worst->excess)) worst = std::move(found);
  }
  if (!worst) return false;
  LetWait(worst->run, build).explanations = std::move(worst->explanations);
  return true;
}

}  // namespace shiftmap
