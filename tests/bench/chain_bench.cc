// SPDX-License-Identifier: Apache-2.0
//
// Time of learning the chains of a map: landmarks of three places that stay 15 days at each, seen
// at random times. Items are rows of the ledger.
#include <benchmark/benchmark.h>

#include <fmt/format.h>

#include <cstdint>
#include <random>
#include <vector>

#include "mapper/chain/group_chains.h"
#include "tools/sim/simulate_chain.h"

namespace shiftmap {
namespace {

constexpr int kModes = 3;
constexpr double kStayS = 15.0 * 86'400.0;

LandmarkGroup Group(int index) {
  LandmarkGroup group;
  group.signature = Signature(fmt::format("L{:05}", index));
  for (int i = 1; i <= kModes; ++i) {
    Mode mode;
    mode.number = ModeNumber(i);
    group.modes.push_back(mode);
  }
  group.chain = ModeChain::Uniform(kModes, 1.0 / kStayS);
  group.probabilities = Eigen::VectorXd::Constant(kModes + 1, 1.0 / (kModes + 1));
  return group;
}

// A vehicle sees the landmark where it is, in some visits another one.
void AddRows(const LandmarkGroup& group,
             int rows,
             double mean_gap_s,
             std::mt19937_64* random,
             std::vector<EvidenceRow>* evidence) {
  std::exponential_distribution<double> gap(1.0 / mean_gap_s);
  std::vector<Stamp> stamps;
  double time = 0.0;
  for (int i = 0; i < rows; ++i) stamps.push_back(Stamp(FromSeconds(time += gap(*random))));
  const ChainPath path = SimulateChain(group.chain, 1, stamps.front(), stamps.back(), *random);
  for (int i = 0; i < rows; ++i) {
    const Stamp stamp = stamps[static_cast<std::size_t>(i)];
    EvidenceRow row{fmt::format("{}", i), {group.signature, stamp, stamp, {}, 5}, "truck"};
    row.vehicle += std::to_string(i % 5);
    for (int state = 0; state <= kModes; ++state) {
      row.evidence.modes.push_back({ModeNumber(state), state == path.At(stamp) ? 0.0 : -12.0});
    }
    evidence->push_back(std::move(row));
  }
}

void BM_LearnGroupChains(benchmark::State& state) {
  std::mt19937_64 random(1);
  std::vector<LandmarkGroup> groups;
  std::vector<EvidenceRow> evidence;
  const auto rows = static_cast<int>(state.range(1));
  const double mean_gap_s = 60.0 * static_cast<double>(state.range(2));
  for (int i = 0; i < state.range(0); ++i) {
    groups.push_back(Group(i));
    AddRows(groups.back(), rows, mean_gap_s, &random, &evidence);
  }
  for (auto _ : state) {
    benchmark::DoNotOptimize(LearnGroupChains(groups, evidence, {}));
  }
  state.SetItemsProcessed(state.iterations() * state.range(0) * rows);
}
BENCHMARK(BM_LearnGroupChains)
    ->ArgNames({"groups", "rows", "gap_min"})
    ->Args({20, 300, 180})
    ->Args({20, 3'000, 180})
    ->Args({200, 300, 180})
    ->Args({1'000, 60, 4'800})
    ->Args({1'000, 1'000, 180})
    ->Args({10, 100'000, 10})
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace shiftmap
