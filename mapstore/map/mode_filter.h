// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/landmark_group.h"
#include "mapstore/map/vehicle_records.h"

namespace shiftmap {

/// What one vehicle has said of a landmark since another one spoke of it, its turn: all of its
/// visits are right, or all are mistakes. Distributions over the chain's states, at the stamp of
/// the ModeState.
struct VehicleTurn {
  std::int64_t vehicle = 0;       ///< VehicleKey of its name.
  Eigen::VectorXd log_right;      ///< If the visits are right. [nat]
  Eigen::VectorXd log_own;        ///< By the visits alone, from where the chain relaxes to. [nat]
  Eigen::VectorXd mistaken;       ///< If the visits are mistakes: what was known before.
  double log_bayes_factor = 0.0;  ///< Of mistaken over right. [nat]
};

/// Stands for a vehicle's name, the same on all machines: the first 64 bits of its SHA-256.
std::int64_t VehicleKey(std::string_view vehicle);

/// The distribution of a group's chain over its states while evidence is filtered.
struct ModeState {
  Eigen::VectorXd log_probabilities;  ///< While there is no turn. [nat]
  Stamp stamp;                        ///< They hold at this time.
  bool started = false;  ///< Evidence has come; without it the stamp may still go back.
  std::optional<VehicleTurn> turn = std::nullopt;  ///< Of the vehicle that spoke last.

  /// Size states, entry 0 is `absent`.
  Eigen::VectorXd Probabilities(const VehicleRecords& records) const;

  /// Probability that the turn is a mistake; 0 without one.
  double MistakenShare(const VehicleRecords& records) const;
};

/// False if evidence favours a mode that the group does not have: carried over to the others it
/// would say what nobody saw. A merged mode is there as the mode that stands for it.
bool FavoursKnownMode(const LandmarkGroup& group,
                      const std::vector<VisitEvidence::ModeLogLikelihood>& evidence);

/// How evidence of one visit reads for a group: one log-likelihood per state. [nat]
///
/// A merged mode's value goes to the mode that stands for it now; of several the largest counts. A
/// mode that the evidence does not name was not known to whoever made it; for that vehicle the
/// landmark was at no known position, so the mode gets the value of `absent`.
///
/// @param evidence  Names `absent` first; all values finite.
/// @param values    Gets the result; size states.
/// @returns What FavoursKnownMode says.
bool StateLogLikelihoods(const LandmarkGroup& group,
                         const std::vector<VisitEvidence::ModeLogLikelihood>& evidence,
                         Eigen::VectorXd* values);

/// The group's own probabilities.
ModeState StartModes(const LandmarkGroup& group, Stamp stamp);

/// One visit of a filter that goes through them in the order of time, T-IV (13, 14), with what one
/// vehicle can say bounded (mapstore/METHOD.md). If the first visit begins before the prior's
/// stamp, the prior holds at its begin.
///
/// @param vehicle  VehicleKey of its name.
/// @param records  Have ε of the vehicle, and that of the one whose turn the visit ends.
/// @returns What the visit, if it ends another vehicle's turn, says of that.
std::optional<TurnVerdict> AddVisit(const LandmarkGroup& group,
                                    Stamp begin,
                                    Stamp end,
                                    std::int64_t vehicle,
                                    const VehicleRecords& records,
                                    const Eigen::VectorXd& log_likelihoods,
                                    ModeState* state);

/// The probability of a mode as somebody states it.
struct StatedMode {
  ModeNumber number;
  double probability = 0.0;
};

/// What is stated of a group when it had other modes, per state: a mode that was merged gives its
/// probability to the mode that stands for it, one that was not known gets that of `absent`.
/// @param stated  `absent` first.
Eigen::VectorXd CarriedProbabilities(const LandmarkGroup& group,
                                     const std::vector<StatedMode>& stated);

/// A statement: somebody claims probabilities p for a time. It is evidence like a visit's, with the
/// likelihood p / π, π the chain's stationary distribution: after StationaryStart and nothing else
/// the result is p itself, and older visits count for what the chain has not forgotten since. Not
/// bounded: its author is held to it. It ends a vehicle's turn.
/// @param probabilities  Size states; sums to 1.
void AddStatement(const LandmarkGroup& group,
                  const Eigen::VectorXd& probabilities,
                  Stamp stamp,
                  const VehicleRecords& records,
                  ModeState* state);

/// The chain's stationary distribution: where filtering starts if nothing is stated.
ModeState StationaryStart(const LandmarkGroup& group, Stamp stamp);

/// One row of the evidence ledger.
struct EvidenceRow {
  std::string source;  ///< UUID of the report, or SHA-256 of the mapped run.
  VisitEvidence evidence;
  std::string vehicle = {};
};

/// The order of time, which the rows of one landmark are filtered in.
inline auto OrderInTime(const EvidenceRow& row) {
  return std::tie(row.evidence.begin, row.evidence.end, row.vehicle, row.source);
}

/// The rows in OrderInTime(), each once.
std::vector<EvidenceRow> InOrder(std::vector<EvidenceRow> rows);

/// AddVisit over all rows that do not favour a mode that the group does not have, with
/// kMistakeProbability for every vehicle.
/// @param rows  Of the group's landmark, in any order and with repetitions: taken InOrder, so the
///              result is the same bit by bit.
ModeState FilterModes(const LandmarkGroup& group, ModeState start, std::vector<EvidenceRow> rows);

/// The distribution at a time not before `state.stamp`; for an earlier one, the state's own.
Eigen::VectorXd ProbabilitiesAt(const LandmarkGroup& group,
                                const ModeState& state,
                                Stamp at,
                                const VehicleRecords& records = {});

}  // namespace shiftmap
