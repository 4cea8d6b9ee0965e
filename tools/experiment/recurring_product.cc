// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/recurring_product.h"

#include <fmt/format.h>

#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapper/chain/group_chains.h"
#include "mapstore/core/day.h"
#include "mapstore/core/folder.h"
#include "mapstore/map_store.h"

namespace shiftmap {
namespace {

constexpr char kArea[] = "replay";

// The landmark before anything is known of when it moves.
MapContent MakeMap(const ChainHistory& history) {
  const int modes = history.states - 1;
  MapContent content;
  content.stamp = history.visits.front().begin - FromSeconds(1.0);
  LandmarkGroup group;
  group.signature = history.signature;
  for (int mode = 1; mode <= modes; ++mode) {
    group.modes.push_back({ModeNumber(mode),
                           {static_cast<double>(mode), 0.0},
                           1e-4 * Eigen::Matrix2d::Identity(),
                           content.stamp});
  }
  group.chain = ModeChain::Uniform(modes, GroupChainOptions().leave_rate_per_s);
  group.probabilities = group.chain.stationary();
  content.groups = {std::move(group)};
  content.covariance =
      JointCovariance(std::vector<Eigen::Matrix2d>(static_cast<std::size_t>(modes),
                                                   1e-4 * Eigen::Matrix2d::Identity()),
                      {});
  return content;
}

// Hands in the visits from number `first` on, a report for each day.
Status ReturnDays(const ChainHistory& history,
                  std::size_t first,
                  const MapSnapshot& map,
                  MapStore* store) {
  const std::vector<ChainVisit>& visits = history.visits;
  for (std::size_t i = first; i < visits.size();) {
    ShiftReport report;
    report.uuid = fmt::format("{:08x}-0000-4000-8000-{:012x}", map.version().value(), i);
    report.vehicle = "watcher";
    report.area = kArea;
    report.version = map.version();
    report.content_hash = map.content_hash();
    report.software = "shiftmap-experiment";
    report.begin = visits[i].begin;
    const Stamp evening = report.begin + FromSeconds(kSecondsPerDay);
    for (; i < visits.size() && visits[i].begin < evening; ++i) {
      VisitEvidence visit{history.signature, visits[i].begin, visits[i].end, {}, 1};
      for (int state = 0; state < history.states; ++state) {
        visit.modes.push_back({ModeNumber(state), visits[i].log_likelihoods(state)});
      }
      report.end = visit.end;
      report.evidence.push_back(std::move(visit));
    }
    SHIFTMAP_RETURN_IF_ERROR(store->Return(report).status());
  }
  return OkStatus();
}

// The version that a night makes of the rows that came.
StatusOr<GroupChain> FitNight(const MapSnapshot& map, Stamp end, MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<EvidenceRow> rows,
                            store->Evidence(kArea, map.version()));
  MapContent content = map.content();
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<GroupChain> chains,
                            LearnGroupChains(content.groups, rows, {}));
  content.groups.front().chain = chains.front().chain.chain;
  content.stamp = end;
  CommitOptions commit;
  commit.parent = map.version();
  commit.states_probabilities = false;
  SHIFTMAP_RETURN_IF_ERROR(store->Commit(kArea, content, {}, commit).status());
  return std::move(chains.front());
}

// Whether a version has the chain that its rows speak for.
StatusOr<bool> IsRecomputed(const MapSnapshot& map, MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<EvidenceRow> rows,
                            store->Evidence(kArea, map.version()));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<GroupChain> chains,
                            LearnGroupChains(map.groups(), rows, {}));
  const ModeChain& stored = map.groups().front().chain;
  const ModeChain& learned = chains.front().chain.chain;
  if (stored.rate_matrix() != learned.rate_matrix()) return false;
  if (stored.rhythm() == nullptr || learned.rhythm() == nullptr) {
    return stored.rhythm() == learned.rhythm();
  }
  return *stored.rhythm() == *learned.rhythm();
}

}  // namespace

StatusOr<ReplayedRecord> ReplayRecord(const ChainHistory& train, const ChainHistory& test) {
  SHIFTMAP_ASSIGN_OR_RETURN(const ScratchFolder folder, ScratchFolder::Make());
  MapStore::OpenOptions options;
  options.access = MapStore::Access::kReadWriteCreate;
  options.checkpoint_rows = 256;  // A map is loaded for every visit.
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, MapStore::Open(folder.path() + "/maps.db", options));
  SHIFTMAP_RETURN_IF_ERROR(store.Commit(kArea, MakeMap(train), {}, {}).status());
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot first, store.LoadAt(kArea));
  SHIFTMAP_RETURN_IF_ERROR(ReturnDays(train, 0, first, &store));
  SHIFTMAP_ASSIGN_OR_RETURN(const GroupChain learned,
                            FitNight(first, train.visits.back().end, &store));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot night, store.LoadAt(kArea));
  ReplayedRecord result;
  SHIFTMAP_ASSIGN_OR_RETURN(result.recomputed, IsRecomputed(night, &store));
  // What the training has already is no row twice.
  const bool known = test.visits.front().begin <= train.visits.back().end;
  SHIFTMAP_RETURN_IF_ERROR(ReturnDays(test, known ? 1 : 0, night, &store));
  for (std::size_t i = 1; i < test.visits.size(); ++i) {
    const ChainVisit& visit = test.visits[i];
    SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map,
                              store.LoadAt(kArea, std::nullopt, visit.begin - Duration(1)));
    const Eigen::VectorXd likelihoods = visit.log_likelihoods.array().exp();
    result.nats_per_hour += std::log(map.groups().front().probabilities.dot(likelihoods));
  }
  const double seconds = ToSeconds(test.visits.back().end - test.visits.front().begin);
  result.nats_per_hour /= seconds / 3600.0;
  result.leave_per_day = kSecondsPerDay * learned.chain.leave.rate_per_s;
  result.low_per_day = kSecondsPerDay * learned.chain.leave.low_per_s;
  result.high_per_day = kSecondsPerDay * learned.chain.leave.high_per_s;
  if (const ChainRhythm* const rhythm = learned.chain.chain.rhythm()) {
    result.rhythm = rhythm->calendar().period;
  }
  return result;
}

}  // namespace shiftmap
