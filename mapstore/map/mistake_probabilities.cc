// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mistake_probabilities.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <optional>
#include <string_view>
#include <tuple>
#include <unordered_map>

namespace shiftmap {
namespace {

std::vector<std::size_t> OrderOfTime(const std::vector<EvidenceRow>& rows) {
  std::vector<std::size_t> order(rows.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto key = [&](std::size_t i) {
    return std::tuple_cat(OrderInTime(rows[i]), std::tie(rows[i].evidence.signature));
  };
  std::sort(
      order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
  return order;
}

}  // namespace

std::vector<double> MistakeProbabilities(const std::vector<LandmarkGroup>& groups,
                                         const std::vector<EvidenceRow>& rows) {
  std::unordered_map<std::string_view, std::size_t> index;
  for (std::size_t i = 0; i < groups.size(); ++i) index.emplace(groups[i].signature.text(), i);
  std::unordered_map<std::string_view, std::int64_t> keys;
  std::vector<double> mistaken(rows.size(), 0.0);
  std::vector<std::optional<ModeState>> states(groups.size());
  std::vector<std::vector<std::size_t>> turns(groups.size());  // Rows of the present one.
  const auto close = [&](double probability, std::size_t group) {
    for (const std::size_t row : turns[group]) mistaken[row] = probability;
    turns[group].clear();
  };
  VehicleRecords records;
  Eigen::VectorXd log_likelihoods;
  for (const std::size_t row : OrderOfTime(rows)) {
    const VisitEvidence& visit = rows[row].evidence;
    const auto found = index.find(visit.signature.text());
    if (found == index.end()) continue;
    const LandmarkGroup& group = groups[found->second];
    if (!StateLogLikelihoods(group, visit.modes, &log_likelihoods)) continue;
    const auto [key, is_new] = keys.try_emplace(rows[row].vehicle, 0);
    if (is_new) key->second = VehicleKey(rows[row].vehicle);
    std::optional<ModeState>& state = states[found->second];
    if (!state) state = StationaryStart(group, visit.begin);
    const std::optional<TurnVerdict> verdict =
        AddVisit(group, visit.begin, visit.end, key->second, records, log_likelihoods, &*state);
    if (verdict) {
      records.Add(*verdict);
      close(verdict->mistaken, found->second);
    }
    turns[found->second].push_back(row);
  }
  for (std::size_t i = 0; i < groups.size(); ++i) {
    if (states[i]) close(states[i]->MistakenShare(records), i);
  }
  return mistaken;
}

}  // namespace shiftmap
