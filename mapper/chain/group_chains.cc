// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/group_chains.h"

#include <cmath>
#include <map>
#include <utility>

#include "mapper/chain/chain_history.h"
#include "mapper/chain/learn_rhythm.h"
#include "mapper/parallel.h"
#include "mapstore/map/mistake_probabilities.h"

namespace shiftmap {
namespace {

// Visits of which the chain must be seen at least to say anything of its rates.
constexpr std::size_t kMinVisits = 2;

// Groups' worth that the usual leave rate counts against the rates of this map's groups.
constexpr double kUsualGroups = 3.0;

// Far below the spread of a rate that a hundred jumps tell of, 0.1.
constexpr double kGapResolution = 0.02;

// A visit with a larger probability of a mistake is left out. The usual chains judge the visits: a
// chain that was learned from a lie every day has the landmark move every day.
constexpr double kMistaken = 0.5;

std::vector<LandmarkGroup> WithUsualChains(std::vector<LandmarkGroup> groups,
                                           double leave_rate_per_s) {
  for (LandmarkGroup& group : groups) {
    group.chain = ModeChain::Uniform(group.chain.states() - 1, leave_rate_per_s);
  }
  return groups;
}

std::vector<ChainHistory> MakeHistories(const std::vector<LandmarkGroup>& groups,
                                        const std::vector<EvidenceRow>& evidence,
                                        const GroupChainOptions& options) {
  std::map<Signature, std::vector<EvidenceRow>> rows;
  for (const LandmarkGroup& group : groups) rows.try_emplace(group.signature);
  const std::vector<double> mistaken =
      MistakeProbabilities(WithUsualChains(groups, options.leave_rate_per_s), evidence);
  for (std::size_t i = 0; i < evidence.size(); ++i) {
    if (mistaken[i] > kMistaken) continue;
    const auto found = rows.find(evidence[i].evidence.signature);
    if (found != rows.end()) found->second.push_back(evidence[i]);
  }
  std::vector<ChainHistory> histories;
  for (const LandmarkGroup& group : groups) {
    histories.push_back(AllowMistakes(MakeChainHistory(group, std::move(rows[group.signature])),
                                      options.mistaken_visits));
    const auto stated = options.stated.find(group.signature);
    if (stated != options.stated.end()) histories.back().stated = stated->second;
  }
  return histories;
}

// Gives chains the rhythms that their histories support, and says how well they do.
// @param learning  With the prior that the chains were learned with.
Status AddRhythms(const std::vector<ChainHistory>& histories,
                  const ChainLearningOptions& learning,
                  const GroupChainOptions& options,
                  std::vector<LearnedChain>* chains,
                  std::vector<double>* gains) {
  RhythmOptions rhythm;
  rhythm.gap_resolution = kGapResolution;
  std::vector<Status> learned(histories.size());
  ForEachIndex(histories.size(), options.threads, [&](std::size_t i) {
    LearnedChain& learned_chain = (*chains)[i];
    ChainLearningOptions alike = learning;
    alike.structure = learned_chain.fit.structure;
    alike.threads = 1;
    StatusOr<LearnedRhythm> found = LearnRhythm(histories[i], learned_chain.fit, alike, rhythm);
    learned[i] = found.status();
    if (!found.ok()) return;
    (*gains)[i] = found->held_out_gain;
    if (!found->rhythm) return;
    learned_chain.chain = *learned_chain.chain.WithRhythm(*std::move(found->rhythm));
  });
  for (const Status& status : learned) SHIFTMAP_RETURN_IF_ERROR(status);
  return OkStatus();
}

}  // namespace

Status GroupChainOptions::Validate() const {
  if (!(leave_rate_per_s > 0.0) || !std::isfinite(leave_rate_per_s)) {
    return InvalidArgument("mode chains: leave rate {} per s, expected > 0", leave_rate_per_s);
  }
  if (!(prior_jumps > 0.0) || !std::isfinite(prior_jumps)) {
    return InvalidArgument("mode chains: prior of {} jumps, expected > 0", prior_jumps);
  }
  if (!(mistaken_visits >= 0.0 && mistaken_visits < 1.0)) {
    return InvalidArgument("mode chains: {} mistaken visits, expected within [0, 1)",
                           mistaken_visits);
  }
  for (const auto& [signature, rate] : stated) {
    if (!(rate.jumps > 0.0 && rate.seconds > 0.0 && std::isfinite(rate.jumps / rate.seconds))) {
      return InvalidArgument("mode chains: '{}': {} jumps in {} s stated, expected > 0",
                             signature.text(),
                             rate.jumps,
                             rate.seconds);
    }
  }
  return OkStatus();
}

StatusOr<std::vector<GroupChain>> LearnGroupChains(const std::vector<LandmarkGroup>& groups,
                                                   const std::vector<EvidenceRow>& evidence,
                                                   const GroupChainOptions& options) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  std::vector<ChainHistory> known;
  std::vector<ChainHistory> unknown;
  std::vector<bool> learned;
  for (ChainHistory& history : MakeHistories(groups, evidence, options)) {
    learned.push_back(history.visits.size() >= kMinVisits);
    (learned.back() ? known : unknown).push_back(std::move(history));
  }
  ChainLearningOptions learning;
  learning.prior = {options.prior_jumps, options.prior_jumps / options.leave_rate_per_s};
  learning.prior_groups = kUsualGroups;
  learning.gap_resolution = kGapResolution;
  learning.threads = options.threads;
  SHIFTMAP_ASSIGN_OR_RETURN(LearnedChains of_known, LearnChains(known, learning));

  learning.prior = of_known.prior;
  learning.share_prior = false;
  std::vector<double> gains(known.size(), 0.0);
  if (options.learn_rhythms) {
    SHIFTMAP_RETURN_IF_ERROR(AddRhythms(known, learning, options, &of_known.chains, &gains));
  }
  learning.structure = ChainStructure::kUniform;
  SHIFTMAP_ASSIGN_OR_RETURN(LearnedChains of_unknown, LearnChains(unknown, learning));

  std::vector<GroupChain> result;
  std::size_t next_known = 0;
  auto next_unknown = of_unknown.chains.begin();
  for (const bool is_learned : learned) {
    if (is_learned) {
      result.push_back({std::move(of_known.chains[next_known]), gains[next_known], true});
      ++next_known;
    } else {
      result.push_back({std::move(*next_unknown++), 0.0, false});
    }
  }
  return result;
}

}  // namespace shiftmap
