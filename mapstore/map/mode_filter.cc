// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mode_filter.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "mapstore/map/sha256.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr double kImpossible = -std::numeric_limits<double>::infinity();

// Eigen's vectorized exp(-inf) is a denormal number; an impossible mode must stay at exactly 0.
Eigen::VectorXd Exp(const Eigen::VectorXd& values) {
  return values.unaryExpr([](double value) { return std::exp(value); });
}

Eigen::VectorXd Log(const Eigen::VectorXd& values) {
  return values.unaryExpr([](double value) { return std::log(value); });
}

// Subtracts log Σ exp, and returns it. Nothing left to normalize stays as it is.
double Normalize(Eigen::VectorXd* log_probabilities) {
  const double largest = log_probabilities->maxCoeff();
  if (largest == kImpossible) return kImpossible;
  double sum = 0.0;
  for (double& value : *log_probabilities) {
    value -= largest;
    sum += std::exp(value);
  }
  log_probabilities->array() -= std::log(sum);
  return largest + std::log(sum);
}

// Moves distributions of one chain forward by the same time.
class ChainStep {
 public:
  // Nothing moves if `to` is not later.
  ChainStep(const ModeChain& chain, Stamp from, Stamp to)
      : moves_(from < to && chain.leave_rate_per_s() > 0.0) {
    if (!moves_) return;
    if (chain.uniform() && chain.rhythm() == nullptr) {
      forgotten_ = chain.Forgotten(Elapsed(from, to));
    } else {
      reversed_ = chain.Transition(from, to).transpose();
    }
  }

  void Move(Eigen::VectorXd* probabilities) const {
    if (!moves_) return;
    if (reversed_.size() > 0) {
      *probabilities = reversed_ * *probabilities;
    } else {
      ModeChain::Spread(forgotten_, probabilities);
    }
  }

  void MoveLog(Eigen::VectorXd* log_probabilities) const {
    if (!moves_) return;
    Eigen::VectorXd probabilities = Exp(*log_probabilities);
    Move(&probabilities);
    *log_probabilities = Log(probabilities);
  }

 private:
  bool moves_;
  double forgotten_ = 0.0;    // Of a uniform chain.
  Eigen::MatrixXd reversed_;  // Πᵀ of a general one, which costs more than what it is used for.
};

// @param own, right  log Σ of what a visit has added to `log_own` and `log_right`.
void EndVisit(double own, double right, VehicleTurn* turn) {
  turn->log_bayes_factor += own - right;
  // The chain cannot be where the vehicle says.
  if (right == kImpossible) turn->log_right = Log(turn->mistaken);
}

// What was seen in a visit, over the largest likelihood: a mode's may be beyond what a double
// holds.
struct Likelihoods {
  Likelihoods(const ModeChain& chain, const Eigen::VectorXd& of_log)
      : log(of_log),
        log_largest(of_log.maxCoeff()),
        values(Exp(of_log.array() - log_largest)),
        mean_of_chain(chain.stationary().dot(values)) {}

  const Eigen::VectorXd& log;
  double log_largest;
  Eigen::VectorXd values;
  double mean_of_chain;  // Where the landmark is as the chain relaxes to.
};

// Adds a visit to a distribution.
// @param mean  Σ_k p_k values_k of the distribution: what Normalize() would sum up anew.
// Returns the log of Σ_k p_k exp(log_k).
double AddFirst(const Likelihoods& visit, double mean, Eigen::VectorXd* log_probabilities) {
  *log_probabilities += visit.log;
  if (!(mean > 0.0)) return Normalize(log_probabilities);
  const double log_mean = visit.log_largest + std::log(mean);
  log_probabilities->array() -= log_mean;
  return log_mean;
}

// The first visit of a vehicle that has not spoken since another one did.
void BeginTurn(const ModeChain& chain,
               std::int64_t vehicle,
               Eigen::VectorXd known,
               const Likelihoods& visit,
               VehicleTurn* turn) {
  turn->vehicle = vehicle;
  turn->log_right = Log(known);
  if (chain.uniform()) {
    turn->log_own.setConstant(known.size(), std::log(chain.stationary()(0)));
  } else {
    turn->log_own = Log(chain.stationary());
  }
  turn->mistaken = std::move(known);
  turn->log_bayes_factor = 0.0;
  const double right = AddFirst(visit, turn->mistaken.dot(visit.values), &turn->log_right);
  const double own = AddFirst(visit, visit.mean_of_chain, &turn->log_own);
  EndVisit(own, right, turn);
}

// Bayes factor of mistaken over right, as far as a double has it.
double BayesFactor(const VehicleTurn& turn) {
  constexpr double kMost = 500.0;  // [nat]
  return std::exp(std::clamp(turn.log_bayes_factor, -kMost, kMost));
}

double ShareOfMistake(double prior, double bayes_factor) {
  return prior * bayes_factor / (1.0 - prior + prior * bayes_factor);
}

// What the first visit of another vehicle, which may be a mistake too, says of a turn.
// @param prior                Of the turn being a mistake.
// @param right, mistaken      Of the turn, moved to the begin of the visit.
// @param mistake_probability  Of the visit.
TurnVerdict Judge(const VehicleTurn& turn,
                  double prior,
                  const Eigen::VectorXd& right,
                  const Eigen::VectorXd& mistaken,
                  double mistake_probability,
                  const Likelihoods& visit) {
  const double by_itself = mistake_probability * visit.mean_of_chain;
  const double if_right = (1.0 - mistake_probability) * right.dot(visit.values) + by_itself;
  const double if_mistaken = (1.0 - mistake_probability) * mistaken.dot(visit.values) + by_itself;
  double bayes_factor = BayesFactor(turn);
  if (if_right > 0.0 && if_mistaken > 0.0) bayes_factor *= if_mistaken / if_right;
  return {turn.vehicle, ShareOfMistake(prior, bayes_factor), bayes_factor};
}

}  // namespace

double ModeState::MistakenShare(const VehicleRecords& records) const {
  if (!turn) return 0.0;
  return ShareOfMistake(records.MistakeProbability(turn->vehicle), BayesFactor(*turn));
}

Eigen::VectorXd ModeState::Probabilities(const VehicleRecords& records) const {
  if (!turn) return Exp(log_probabilities);
  const double share = MistakenShare(records);
  return (1.0 - share) * Exp(turn->log_right) + share * turn->mistaken;
}

std::int64_t VehicleKey(std::string_view vehicle) {
  Sha256 hash;
  hash.Update(vehicle);
  const std::string digits = hash.HexDigest().substr(0, 16);
  return static_cast<std::int64_t>(std::stoull(digits, nullptr, 16));
}

bool FavoursKnownMode(const LandmarkGroup& group,
                      const std::vector<VisitEvidence::ModeLogLikelihood>& evidence) {
  double known = kImpossible;
  double unknown = kImpossible;
  for (const VisitEvidence::ModeLogLikelihood& mode : evidence) {
    double& side = group.CarriedStateOf(mode.mode) >= 0 ? known : unknown;
    side = std::max(side, mode.log_likelihood);
  }
  return unknown <= known;
}

bool StateLogLikelihoods(const LandmarkGroup& group,
                         const std::vector<VisitEvidence::ModeLogLikelihood>& evidence,
                         Eigen::VectorXd* values) {
  SHIFTMAP_CHECK(!evidence.empty() && evidence.front().mode == kAbsent,
                 "evidence of '{}' does not name absent",
                 group.signature.text());
  values->setConstant(group.chain.states(), kImpossible);
  for (const VisitEvidence::ModeLogLikelihood& mode : evidence) {
    const int state = group.CarriedStateOf(mode.mode);
    if (state >= 0) (*values)(state) = std::max((*values)(state), mode.log_likelihood);
  }
  for (double& value : *values) {
    if (value == kImpossible) value = evidence.front().log_likelihood;
  }
  return FavoursKnownMode(group, evidence);
}

ModeState StartModes(const LandmarkGroup& group, Stamp stamp) {
  return {Log(group.probabilities), stamp};
}

// Works on logarithms: evidence of overlapping visits may exclude a mode beyond what a double can
// hold and bring it back before any time passes.
std::optional<TurnVerdict> AddVisit(const LandmarkGroup& group,
                                    Stamp begin,
                                    Stamp end,
                                    std::int64_t vehicle,
                                    const VehicleRecords& records,
                                    const Eigen::VectorXd& log_likelihoods,
                                    ModeState* state) {
  std::optional<TurnVerdict> verdict;
  if (!state->started) state->stamp = std::min(state->stamp, begin);
  state->started = true;
  const ChainStep step(group.chain, state->stamp, begin);
  if (state->turn && state->turn->vehicle == vehicle) {
    step.MoveLog(&state->turn->log_right);
    step.MoveLog(&state->turn->log_own);
    step.Move(&state->turn->mistaken);
    VehicleTurn& turn = *state->turn;
    turn.log_own += log_likelihoods;
    turn.log_right += log_likelihoods;
    const double right = Normalize(&turn.log_right);
    EndVisit(Normalize(&turn.log_own), right, &turn);
  } else {
    const Likelihoods visit(group.chain, log_likelihoods);
    Eigen::VectorXd known;
    if (state->turn) {
      Eigen::VectorXd right = Exp(state->turn->log_right);
      Eigen::VectorXd& mistaken = state->turn->mistaken;
      step.Move(&right);
      step.Move(&mistaken);
      const double share = state->MistakenShare(records);
      known = (1.0 - share) * right + share * mistaken;
      verdict = Judge(*state->turn,
                      records.MistakeProbability(state->turn->vehicle),
                      right,
                      mistaken,
                      records.MistakeProbability(vehicle),
                      visit);
    } else {
      known = Exp(state->log_probabilities);
      step.Move(&known);
      state->turn.emplace();
    }
    BeginTurn(group.chain, vehicle, std::move(known), visit, &*state->turn);
  }
  state->stamp = std::max(state->stamp, end);
  return verdict;
}

Eigen::VectorXd CarriedProbabilities(const LandmarkGroup& group,
                                     const std::vector<StatedMode>& stated) {
  SHIFTMAP_CHECK(!stated.empty(), "nothing is stated of '{}'", group.signature.text());
  Eigen::VectorXd probabilities = Eigen::VectorXd::Zero(group.chain.states());
  std::vector<bool> named(static_cast<std::size_t>(group.chain.states()));
  for (const StatedMode& mode : stated) {
    const int state = group.CarriedStateOf(mode.number);
    if (state < 0) continue;
    probabilities(state) += mode.probability;
    named[static_cast<std::size_t>(state)] = true;
  }
  for (std::size_t state = 0; state < named.size(); ++state) {
    if (named[state]) continue;
    probabilities(static_cast<Eigen::Index>(state)) = stated.front().probability;
  }
  return probabilities;
}

void AddStatement(const LandmarkGroup& group,
                  const Eigen::VectorXd& probabilities,
                  Stamp stamp,
                  const VehicleRecords& records,
                  ModeState* state) {
  const Eigen::VectorXd stationary = Log(group.chain.stationary());
  Eigen::VectorXd ratio = Log(probabilities);
  for (Eigen::Index i = 0; i < ratio.size(); ++i) {
    if (stationary(i) != kImpossible) ratio(i) -= stationary(i);
  }
  const Stamp before = state->started ? state->stamp : std::min(state->stamp, stamp);
  Eigen::VectorXd known = state->Probabilities(records);
  ChainStep(group.chain, before, stamp).Move(&known);
  Eigen::VectorXd log_probabilities = Log(known) + ratio;
  // What excludes all that is stated says that one of the two is wrong: not which.
  if (Normalize(&log_probabilities) == kImpossible) return;
  *state = {std::move(log_probabilities), std::max(before, stamp), true};
}

ModeState StationaryStart(const LandmarkGroup& group, Stamp stamp) {
  return {Log(group.chain.stationary()), stamp};
}

std::vector<EvidenceRow> InOrder(std::vector<EvidenceRow> rows) {
  std::sort(rows.begin(), rows.end(), [](const EvidenceRow& a, const EvidenceRow& b) {
    return OrderInTime(a) < OrderInTime(b);
  });
  const auto end = std::unique(rows.begin(), rows.end(), [](const auto& a, const auto& b) {
    return OrderInTime(a) == OrderInTime(b);
  });
  rows.erase(end, rows.end());
  return rows;
}

ModeState FilterModes(const LandmarkGroup& group, ModeState start, std::vector<EvidenceRow> rows) {
  const VehicleRecords records;
  Eigen::VectorXd log_likelihoods;
  for (const EvidenceRow& row : InOrder(std::move(rows))) {
    if (!StateLogLikelihoods(group, row.evidence.modes, &log_likelihoods)) continue;
    AddVisit(group,
             row.evidence.begin,
             row.evidence.end,
             VehicleKey(row.vehicle),
             records,
             log_likelihoods,
             &start);
  }
  return start;
}

Eigen::VectorXd ProbabilitiesAt(const LandmarkGroup& group,
                                const ModeState& state,
                                Stamp at,
                                const VehicleRecords& records) {
  Eigen::VectorXd probabilities = state.Probabilities(records);
  if (at <= state.stamp) return probabilities;
  return group.chain.Propagate(probabilities, state.stamp, at);
}

}  // namespace shiftmap
