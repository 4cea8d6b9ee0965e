// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/recurring_chains.h"

#include <chrono>
#include <cmath>
#include <limits>
#include <random>
#include <utility>

#include "mapper/chain/chain_expectations.h"
#include "mapper/chain/learn_rhythm.h"
#include "mapstore/core/day.h"
#include "tools/experiment/recurring_product.h"
#include "tools/sim/simulate_chain.h"

namespace shiftmap {
namespace {

constexpr char kRhythmMethod[] = "rhythm";
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

// A way to have a chain, before it is tested.
struct Candidate {
  std::string method;
  std::vector<ModeChain> chains;  // One per phase of the period.
  double leave_per_s = kNone;
  double low_per_s = kNone;
  double high_per_s = kNone;
  Duration period = kRhythmDay;
  double rhythm_hours = 0.0;
};

// A time that the rhythm is late by.
ChainHistory Earlier(ChainHistory history, Duration by) {
  for (ChainVisit& visit : history.visits) {
    visit.begin -= by;
    visit.end -= by;
  }
  return history;
}

Candidate Fixed(const std::string& method, const ModeChain& chain) {
  return {method, {chain}, chain.leave_rate_per_s(), kNone, kNone};
}

// Jumps between successive visits by the time after visits of a state. Half a jump from each state
// at the mean rate keeps rates positive.
ModeChain CountJumps(const ChainHistory& history) {
  const int n = history.states;
  Eigen::MatrixXd jumps = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd seconds = Eigen::VectorXd::Zero(n);
  for (std::size_t i = 1; i < history.visits.size(); ++i) {
    Eigen::Index from = 0;
    Eigen::Index to = 0;
    history.visits[i - 1].log_likelihoods.maxCoeff(&from);
    history.visits[i].log_likelihoods.maxCoeff(&to);
    seconds(from) += ToSeconds(history.visits[i].begin - history.visits[i - 1].end);
    if (from != to) jumps(from, to) += 1.0;
  }
  const double mean_rate = (jumps.sum() + 0.5) / seconds.sum();
  const double pseudo = 0.5 / (n - 1);
  Eigen::MatrixXd rates(n, n);
  for (int from = 0; from < n; ++from) {
    rates.row(from) = (jumps.row(from).array() + pseudo) / (seconds(from) + 0.5 / mean_rate);
  }
  rates.diagonal().setZero();
  rates.diagonal() = -rates.rowwise().sum();
  return *ModeChain::FromRates(rates);
}

StatusOr<Candidate> Learn(const std::string& method,
                          ChainStructure structure,
                          const ChainHistory& history,
                          ChainLearningOptions learning) {
  learning.structure = structure;
  SHIFTMAP_ASSIGN_OR_RETURN(const LearnedChain learned, LearnChain(history, learning));
  return Candidate{method,
                   {learned.chain},
                   learned.leave.rate_per_s,
                   learned.leave.low_per_s,
                   learned.leave.high_per_s};
}

StatusOr<std::vector<Candidate>> Candidates(const ChainHistory& history,
                                            const ModeChain* truth,
                                            const RecurringChainsOptions& options) {
  std::vector<Candidate> candidates;
  candidates.push_back(
      Fixed("hand-set", ModeChain::Uniform(history.states - 1, options.hand_set_change / 60.0)));
  candidates.push_back({"frequency", {}, kNone, kNone, kNone});
  candidates.push_back(Fixed("jump count", CountJumps(history)));
  SHIFTMAP_ASSIGN_OR_RETURN(Candidate uniform,
                            Learn("uniform", ChainStructure::kUniform, history, options.learning));
  candidates.push_back(std::move(uniform));
  SHIFTMAP_ASSIGN_OR_RETURN(Candidate general,
                            Learn("general", ChainStructure::kGeneral, history, options.learning));
  candidates.push_back(std::move(general));
  ChainLearningOptions learning = options.learning;
  learning.structure = ChainStructure::kGeneral;
  SHIFTMAP_ASSIGN_OR_RETURN(const LearnedChain whole, LearnChain(history, learning));
  SHIFTMAP_ASSIGN_OR_RETURN(const LearnedRhythm rhythm,
                            LearnRhythm(history, whole.fit, learning, {}));
  Candidate with_rhythm = Fixed(kRhythmMethod, whole.chain);
  if (rhythm.rhythm) {
    with_rhythm.period = rhythm.rhythm->calendar().period;
    with_rhythm.rhythm_hours = ToSeconds(with_rhythm.period) / 3600.0;
    with_rhythm.chains.clear();
    for (const Eigen::MatrixXd& rates : rhythm.rhythm->rate_matrices()) {
      with_rhythm.chains.push_back(*ModeChain::FromRates(rates));
    }
  }
  candidates.push_back(with_rhythm);
  if (truth != nullptr) candidates.push_back(Fixed("truth", *truth));
  return candidates;
}

// A map is loaded before each visit.
bool IsReplayed(const VisitSpacing& train, const VisitSpacing& test) {
  return test.gap_s >= 3600.0 && (train.gap_s == 60.0 || train.gap_s == 3600.0);
}

// log p of all visits but the first, as if each were drawn anew from the shares of the training.
double FrequencyLogLikelihood(const ChainHistory& train, const ChainHistory& test) {
  Eigen::VectorXd counts = Eigen::VectorXd::Ones(train.states);
  for (const ChainVisit& visit : train.visits) {
    Eigen::Index state = 0;
    visit.log_likelihoods.maxCoeff(&state);
    counts(state) += 1.0;
  }
  const Eigen::VectorXd shares = counts / counts.sum();
  double sum = 0.0;
  for (std::size_t i = 1; i < test.visits.size(); ++i) {
    sum += std::log(shares.dot(Eigen::VectorXd(test.visits[i].log_likelihoods.array().exp())));
  }
  return sum;
}

}  // namespace

StatusOr<std::vector<RecurringChainsRow>> CompareChains(
    const RecurringRecord& record,
    const ModeChain* truth,
    const RecurringChainsOptions& options,
    const std::function<void(double)>& progress) {
  const auto count = record.stamps.size();
  const auto split = static_cast<std::size_t>(static_cast<double>(count) * options.train_share);
  if (split < 2 || count - split < 2) {
    return InvalidArgument("record '{}': {} visits are too few", record.name, count);
  }
  std::vector<RecurringChainsRow> rows;
  double done = 0.0;
  for (const VisitSpacing& spacing : options.train) {
    const ChainHistory train =
        VisitRecord(record, SpacedVisits(record, 0, split, spacing, options.seed));
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Candidate> candidates,
                              Candidates(train, truth, options));
    for (const VisitSpacing& test_spacing : options.test) {
      // The first of them is the last thing known.
      const ChainHistory test = VisitRecord(
          record, SpacedVisits(record, split - 1, count, test_spacing, options.seed + 1));
      const double hours = ToSeconds(test.visits.back().end - test.visits.front().begin) / 3600.0;
      const auto add = [&](const Candidate& candidate, double log_likelihood) {
        rows.push_back({record.name,
                        spacing.name,
                        test_spacing.name,
                        candidate.method,
                        log_likelihood / hours,
                        kSecondsPerDay * candidate.leave_per_s,
                        kSecondsPerDay * candidate.low_per_s,
                        kSecondsPerDay * candidate.high_per_s,
                        static_cast<double>(train.visits.size()),
                        candidate.rhythm_hours});
      };
      for (Candidate candidate : candidates) {
        add(candidate,
            candidate.chains.empty()
                ? FrequencyLogLikelihood(train, test)
                : PredictiveLogLikelihood(test, 1, candidate.chains, candidate.period));
        if (!(candidate.rhythm_hours > 0.0)) continue;
        candidate.method = "rhythm, late";
        const ChainHistory earlier = Earlier(test, std::chrono::hours(1));
        add(candidate, PredictiveLogLikelihood(earlier, 1, candidate.chains, candidate.period));
      }
      if (!IsReplayed(spacing, test_spacing)) continue;
      SHIFTMAP_ASSIGN_OR_RETURN(const ReplayedRecord replayed, ReplayRecord(train, test));
      Candidate product;
      product.method = "product";
      product.leave_per_s = replayed.leave_per_day / kSecondsPerDay;
      product.low_per_s = replayed.low_per_day / kSecondsPerDay;
      product.high_per_s = replayed.high_per_day / kSecondsPerDay;
      product.rhythm_hours = ToSeconds(replayed.rhythm) / 3600.0;
      add(product, replayed.nats_per_hour * hours);
    }
    done += 1.0;
    progress(done / static_cast<double>(options.train.size()));
  }
  return rows;
}

RecurringRecord SimulateRecord(const RecurringRecord& like,
                               const ModeChain& chain,
                               std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const ChainPath path = SimulateChain(chain,
                                       like.values.front(),
                                       like.stamps.front(),
                                       like.stamps.back() + FromSeconds(1.0),
                                       random);
  RecurringRecord record{"simulated " + like.name, like.states, like.stamps, {}};
  record.values.reserve(like.stamps.size());
  for (const Stamp stamp : like.stamps) record.values.push_back(path.At(stamp));
  return record;
}

}  // namespace shiftmap
