// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/move_rate_estimate.h"

#include <cmath>

#include "mapstore/map/estimate.h"
#include "mapstore/map/move_rate.h"

namespace shiftmap {
namespace {

constexpr double kPriorJumps = 0.5;

// About log λ, of one gap.
double Information(double rate_per_s, int states, double gap_s) {
  const double others = static_cast<double>(states - 1) / states;
  const double relaxed = std::exp(-rate_per_s * gap_s / others);
  const double moved = others * (1.0 - relaxed);
  const double slope = rate_per_s * gap_s * relaxed;  // λ dp/dλ
  const double variance = moved * (1.0 - moved);
  return variance > 0.0 ? slope * slope / variance : 0.0;
}

}  // namespace

MoveRateEstimate EstimateMoveRate(double rate_per_s, int states, const std::vector<Stamp>& visits) {
  MoveRateEstimate estimate{rate_per_s, 0.0, 0.0, static_cast<int>(visits.size())};
  if (!(rate_per_s > 0.0) || states < 2) return estimate;
  double information = kPriorJumps;
  for (std::size_t i = 1; i < visits.size(); ++i) {
    information += Information(rate_per_s, states, ToSeconds(visits[i] - visits[i - 1]));
  }
  const double factor = std::exp(kSigmas95 / std::sqrt(information));
  estimate.low_per_s = rate_per_s / factor;
  estimate.high_per_s = rate_per_s * factor;
  return estimate;
}

MoveRates EstimateMoveRates(const MapSnapshot& map, const std::vector<EvidenceRow>& evidence) {
  std::map<Signature, std::vector<Stamp>> visits;
  for (const EvidenceRow& row : evidence) {
    if (row.evidence.begin > map.stamp()) continue;
    visits[row.evidence.signature].push_back(row.evidence.begin);
  }
  MoveRates rates;
  for (const LandmarkGroup& group : map.groups()) {
    rates.emplace(
        group.signature,
        EstimateMoveRate(MoveRate(group.chain), group.chain.states(), visits[group.signature]));
  }
  return rates;
}

}  // namespace shiftmap
