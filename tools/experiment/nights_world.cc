// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/nights_world.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <random>
#include <utility>

#include "mapstore/core/day.h"
#include "mapstore/map/mode_chain.h"
#include "tools/experiment/dice.h"
#include "tools/sim/simulate_chain.h"

namespace shiftmap {
namespace {

constexpr int kPlaces = 3;

// How a landmark that stays so long at a place moves; for 0 it never does.
ModeChain ChainOf(double stay_days) {
  constexpr double kAwayShare = 0.1;
  constexpr double kAwayDays = 3.0;
  Eigen::MatrixXd rates = Eigen::MatrixXd::Zero(kPlaces + 1, kPlaces + 1);
  if (stay_days > 0.0) {
    const double leave = 1.0 / (stay_days * kSecondsPerDay);
    rates.bottomRightCorner(kPlaces, kPlaces)
        .setConstant((1.0 - kAwayShare) * leave / (kPlaces - 1));
    rates.col(0).tail(kPlaces).setConstant(kAwayShare * leave);
    rates.row(0).tail(kPlaces).setConstant(1.0 / (kAwayDays * kSecondsPerDay * kPlaces));
    rates.diagonal().setZero();
    rates.diagonal() = -rates.rowwise().sum();
  }
  return *ModeChain::FromRates(rates);
}

double DrawStayDays(Dice* dice) {
  const double kind = dice->Uniform(0.0, 1.0);
  return kind < 0.25 ? 0.0 : kind < 0.75 ? 15.0 : 2.0;
}

// The states of a landmark by run.
std::vector<int> DrawStates(const OpenWorldOptions& world,
                            double stay_days,
                            const std::vector<bool>& new_layout,
                            double layout_share,
                            std::mt19937_64* random,
                            Dice* dice) {
  const Stamp end = world.start + FromSeconds(world.runs * world.shift_interval_s);
  const int start = 1 + static_cast<int>(dice->Uniform(0.0, kPlaces));
  const ChainPath path = SimulateChain(ChainOf(stay_days), start, world.start, end, *random);
  std::vector<int> states;
  int turned = 0;  // By new layouts.
  for (int run = 0; run < world.runs; ++run) {
    if (new_layout[static_cast<std::size_t>(run)] && stay_days > 0.0 && dice->Coin(layout_share)) {
      ++turned;
    }
    const int state = path.At(world.start + FromSeconds(run * world.shift_interval_s));
    states.push_back(state == 0 ? 0 : (state - 1 + turned) % kPlaces + 1);
  }
  return states;
}

}  // namespace

StatusOr<NightsWorld> DrawNights(const NightsOptions& options) {
  OpenWorldOptions world;
  world.seed = options.seed;
  world.groups = options.groups;
  world.modes_per_group = kPlaces;
  world.size_m = options.size_m;
  // A place takes a quarter of what the floor has for each at most, else they may not fit.
  world.mode_gap_m =
      std::min(world.mode_gap_m, 0.5 * options.size_m / std::sqrt(kPlaces * options.groups));
  world.duration_s = options.duration_s;
  world.vehicles = options.vehicles;
  world.runs = options.nights * options.vehicles;
  world.shift_interval_s = kSecondsPerDay / options.vehicles;

  std::vector<bool> new_layout(static_cast<std::size_t>(world.runs), false);
  for (int day = options.layout_days; day > 0 && day < options.nights; day += options.layout_days) {
    new_layout[static_cast<std::size_t>(day * options.vehicles + options.vehicles / 2)] = true;
  }
  Dice dice(options.seed);
  std::mt19937_64 random(options.seed);
  world.states.assign(static_cast<std::size_t>(world.runs), {});
  NightsWorld nights;
  for (int g = 0; g < options.groups; ++g) {
    constexpr double kRemoved = 0.1;
    std::vector<int> states =
        DrawStates(world, DrawStayDays(&dice), new_layout, options.layout_share, &random, &dice);
    std::optional<int>& removed = nights.removed.emplace_back();
    if (dice.Coin(kRemoved)) {
      removed = static_cast<int>(world.runs * dice.Uniform(1.0 / 3.0, 2.0 / 3.0));
      std::fill(states.begin() + *removed, states.end(), 0);
    }
    for (std::size_t run = 0; run < states.size(); ++run) {
      world.states[run].emplace_back(states[run]);
    }
  }
  SHIFTMAP_ASSIGN_OR_RETURN(nights.world, SimulateOpen(world));
  return nights;
}

}  // namespace shiftmap
