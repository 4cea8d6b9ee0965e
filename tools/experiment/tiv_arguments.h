// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "mapstore/cli/command.h"
#include "tools/experiment/tiv_world.h"

namespace shiftmap {

/// The options that the experiments of T-IV IX have in common.
struct TivArguments {
  std::string output;
  std::string noise = "matched";
  std::string motion = "euler";
  std::string errors = "invariant";
  int runs = 100;
  int threads = 1;
  std::uint64_t seed = 1;
  double length_m = TivOptions().length_m;
  bool own_map = false;

  void AddTo(Command* command);
  TivOptions World() const;
  Json OptionsJson() const;

  /// The world of a drive: with the map of all, or with one of its own.
  StatusOr<TivWorld> WorldOf(const TivWorld& world, std::size_t run) const;

  /// Of a drive; the map is of a drive with another one.
  std::uint64_t SeedOf(std::size_t run) const { return 1000 * seed + run + 1; }
};

}  // namespace shiftmap
