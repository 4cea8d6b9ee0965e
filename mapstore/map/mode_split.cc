// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mode_split.h"

#include <algorithm>
#include <optional>

namespace shiftmap {
namespace {

bool Contains(const std::vector<std::string>& runs, const std::string& run) {
  return std::find(runs.begin(), runs.end(), run) != runs.end();
}

}  // namespace

void SplitEvidence(const LandmarkGroup& group,
                   const ModeSplit& split,
                   const std::string& run,
                   std::vector<VisitEvidence::ModeLogLikelihood>* modes) {
  const int state = group.CarriedStateOf(split.mode);
  if (state < 1) return;
  const double absent = modes->front().log_likelihood;
  const bool only_first = Contains(split.first_runs, run);
  const bool only_second = Contains(split.second_runs, run);
  std::optional<double> of_mode;
  for (const VisitEvidence::ModeLogLikelihood& mode : *modes) {
    if (mode.mode == split.second) return;
    if (group.CarriedStateOf(mode.mode) != state) continue;
    of_mode = std::max(of_mode.value_or(mode.log_likelihood), mode.log_likelihood);
  }
  if (!of_mode) return;
  for (VisitEvidence::ModeLogLikelihood& mode : *modes) {
    if (!only_second || group.CarriedStateOf(mode.mode) != state) continue;
    mode.log_likelihood = std::min(mode.log_likelihood, absent);
  }
  const auto place = std::find_if(
      modes->begin(), modes->end(), [&](const auto& mode) { return split.second < mode.mode; });
  modes->insert(place, {split.second, only_first ? std::min(*of_mode, absent) : *of_mode});
}

std::vector<StatedMode> SplitStatement(const LandmarkGroup& group,
                                       const ModeSplit& split,
                                       std::vector<StatedMode> stated) {
  const int state = group.CarriedStateOf(split.mode);
  for (const StatedMode& mode : stated) {
    if (mode.number == split.second) return stated;
  }
  std::optional<double> of_second;
  for (StatedMode& mode : stated) {
    if (state < 1 || group.CarriedStateOf(mode.number) != state) continue;
    mode.probability *= 0.5;
    of_second = of_second.value_or(0.0) + mode.probability;
  }
  if (of_second) stated.push_back({split.second, *of_second});
  return stated;
}

}  // namespace shiftmap
