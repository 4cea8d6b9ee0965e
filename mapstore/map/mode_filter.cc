// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/mode_filter.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <tuple>
#include <utility>

#include "mapstore/map/sha256.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr double kImpossible = -std::numeric_limits<double>::infinity();

// Zero for what is not later. Stores of older versions have stamps further apart than a Duration
// can say.
Duration Elapsed(Stamp from, Stamp to) {
  if (to <= from) return Duration::zero();
  const auto elapsed_ns = static_cast<std::uint64_t>(ToNanoseconds(to)) -
                          static_cast<std::uint64_t>(ToNanoseconds(from));
  return Duration(static_cast<std::int64_t>(
      std::min(elapsed_ns, static_cast<std::uint64_t>(Duration::max().count()))));
}

auto OrderOf(const EvidenceRow& row) {
  return std::tie(row.evidence.begin, row.evidence.end, row.vehicle, row.source);
}

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
  // @param elapsed  Zero: nothing moves.
  ChainStep(const ModeChain& chain, Duration elapsed) : chain_(chain), elapsed_(elapsed) {
    if (moves() && !chain.uniform()) reversed_ = chain.Transition(elapsed).transpose();
  }

  void Move(Eigen::VectorXd* probabilities) const {
    if (!moves()) return;
    *probabilities = chain_.uniform() ? chain_.Propagate(*probabilities, elapsed_)
                                      : Eigen::VectorXd(reversed_ * *probabilities);
  }

  void MoveLog(Eigen::VectorXd* log_probabilities) const {
    if (!moves()) return;
    Eigen::VectorXd probabilities = Exp(*log_probabilities);
    Move(&probabilities);
    *log_probabilities = Log(probabilities);
  }

 private:
  bool moves() const { return elapsed_ > Duration::zero() && chain_.leave_rate_per_s() > 0.0; }

  const ModeChain& chain_;
  Duration elapsed_;
  Eigen::MatrixXd reversed_;  // Πᵀ of a general chain, which costs more than what it is used for.
};

// The turn of a vehicle that has not spoken since another one did, before its first visit.
void BeginTurn(const ModeChain& chain,
               std::int64_t vehicle,
               Eigen::VectorXd known,
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
}

// Probability that a turn is a mistake.
double ShareOfMistake(const VehicleTurn& turn, const VehicleRecords& records) {
  const double prior = records.MistakeProbability(turn.vehicle);
  const double log_odds = std::log(prior) - std::log1p(-prior) + turn.log_bayes_factor;
  return 1.0 / (1.0 + std::exp(-log_odds));
}

// What the first visit of another vehicle, which may be a mistake too, says of a turn.
// @param right, mistaken      Of the turn, moved to the begin of the visit.
// @param mistake_probability  Of the visit.
TurnVerdict Judge(const ModeChain& chain,
                  const VehicleTurn& turn,
                  const VehicleRecords& records,
                  const Eigen::VectorXd& right,
                  const Eigen::VectorXd& mistaken,
                  double mistake_probability,
                  const Eigen::VectorXd& log_likelihoods) {
  const Eigen::VectorXd likelihoods = Exp(log_likelihoods.array() - log_likelihoods.maxCoeff());
  const double by_itself = mistake_probability * chain.stationary().dot(likelihoods);
  const double if_right = (1.0 - mistake_probability) * right.dot(likelihoods) + by_itself;
  const double if_mistaken = (1.0 - mistake_probability) * mistaken.dot(likelihoods) + by_itself;
  VehicleTurn judged;
  judged.vehicle = turn.vehicle;
  judged.log_bayes_factor = turn.log_bayes_factor;
  if (if_right > 0.0 && if_mistaken > 0.0) {
    judged.log_bayes_factor += std::log(if_mistaken) - std::log(if_right);
  }
  return {turn.vehicle, ShareOfMistake(judged, records), judged.log_bayes_factor};
}

}  // namespace

double ModeState::MistakenShare(const VehicleRecords& records) const {
  return turn ? ShareOfMistake(*turn, records) : 0.0;
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
  const ChainStep step(group.chain, Elapsed(state->stamp, begin));
  if (state->turn && state->turn->vehicle == vehicle) {
    step.MoveLog(&state->turn->log_right);
    step.MoveLog(&state->turn->log_own);
    step.Move(&state->turn->mistaken);
  } else {
    Eigen::VectorXd known = state->Probabilities(records);
    step.Move(&known);
    if (state->turn) {
      Eigen::VectorXd right = Exp(state->turn->log_right);
      step.Move(&right);
      step.Move(&state->turn->mistaken);
      verdict = Judge(group.chain,
                      *state->turn,
                      records,
                      right,
                      state->turn->mistaken,
                      records.MistakeProbability(vehicle),
                      log_likelihoods);
    } else {
      state->turn.emplace();
    }
    BeginTurn(group.chain, vehicle, std::move(known), &*state->turn);
  }
  VehicleTurn& turn = *state->turn;
  turn.log_own += log_likelihoods;
  turn.log_right += log_likelihoods;
  const double right = Normalize(&turn.log_right);
  turn.log_bayes_factor += Normalize(&turn.log_own) - right;
  // The chain cannot be where the vehicle says.
  if (right == kImpossible) turn.log_right = Log(turn.mistaken);
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
  ChainStep(group.chain, Elapsed(before, stamp)).Move(&known);
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
    return OrderOf(a) < OrderOf(b);
  });
  const auto end = std::unique(rows.begin(), rows.end(), [](const auto& a, const auto& b) {
    return OrderOf(a) == OrderOf(b);
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
  return group.chain.Propagate(probabilities, Elapsed(state.stamp, at));
}

}  // namespace shiftmap
