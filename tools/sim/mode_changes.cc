// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/mode_changes.h"

namespace shiftmap {
namespace {

bool AreStatesOf(const std::vector<ModeNumber>& run, std::span<const int> modes) {
  if (run.size() != modes.size()) return false;
  for (std::size_t g = 0; g < run.size(); ++g) {
    if (run[g].value() < 0 || run[g].value() > modes[g]) return false;
  }
  return true;
}

}  // namespace

std::vector<std::vector<ModeNumber>> DrawStates(std::span<const int> modes,
                                                int runs,
                                                const ModeChanges& changes,
                                                Random* random) {
  std::vector<std::vector<int>> places(1);
  for (const int n : modes) {
    places[0].push_back(std::uniform_int_distribution<int>(1, n)(*random));
  }
  while (std::ssize(places) < runs) {
    std::vector<int>& next = places.emplace_back(places.back());
    for (std::size_t g = 0; g < modes.size(); ++g) {
      if (modes[g] == 1 || !Happens(changes.change_probability, random)) continue;
      const int step = std::uniform_int_distribution<int>(1, modes[g] - 1)(*random);
      next[g] = (next[g] - 1 + step) % modes[g] + 1;
    }
  }
  std::vector<std::vector<ModeNumber>> states;
  for (const std::vector<int>& of_run : places) {
    std::vector<ModeNumber>& run = states.emplace_back();
    for (const int place : of_run) {
      run.push_back(Happens(changes.absent_probability, random) ? kAbsent : ModeNumber(place));
    }
  }
  return states;
}

Status CheckStates(std::span<const std::vector<ModeNumber>> states,
                   std::span<const int> modes,
                   int runs) {
  if (std::ssize(states) != runs) {
    return InvalidArgument("world: states of {} runs, expected {}", states.size(), runs);
  }
  for (const std::vector<ModeNumber>& run : states) {
    if (!AreStatesOf(run, modes)) {
      return InvalidArgument("world: states of a run, expected a place or 0 for each landmark");
    }
  }
  return OkStatus();
}

}  // namespace shiftmap
