// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/landmark_group.h"

namespace shiftmap {

/// One row of the evidence ledger.
struct EvidenceRow {
  std::string report_uuid;
  VisitEvidence evidence;
};

/// The distribution of a group's chain over its states, and the time at which it holds.
struct ModeState {
  Eigen::VectorXd probabilities;  ///< Size states, entry 0 is `absent`; sums to 1.
  Stamp stamp;
};

/// The posterior of a group's chain given the ledger: T-IV (13, 14) over visits.
///
/// Rows are taken by (begin, end, report UUID), whatever their order here; a row given twice counts
/// once. For each one the chain moves to its begin, p <- Πᵀ(begin - stamp) p, then p_k <- p_k
/// exp(log-likelihood of k), normalized, and the stamp becomes its end: a landmark does not change
/// mode inside a visit. The chain is never run backwards: where visits overlap, or begin before the
/// prior holds, no time passes.
///
/// A mode that a row does not name was not known to whoever made it; for that vehicle the landmark
/// was at no known position, so the mode gets the row's value for `absent`. Modes that the group
/// does not have are ignored.
///
/// @param group  Its probabilities are the prior,
/// @param stamp  which holds at this time.
/// @param rows   Of the group's landmark; each names `absent`, all values finite.
/// Determinism: bit by bit the same for every order of `rows`.
ModeState FilterModes(const LandmarkGroup& group, Stamp stamp, std::vector<EvidenceRow> rows);

/// The distribution at a time not before `state.stamp`; for an earlier one, the state's own.
Eigen::VectorXd PropagateModes(const LandmarkGroup& group, const ModeState& state, Stamp at);

}  // namespace shiftmap
