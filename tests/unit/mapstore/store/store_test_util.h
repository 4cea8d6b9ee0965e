// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/map_store.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {

/// A store for writing, made if it is missing; aborts if it cannot be opened.
MapStore OpenStore(const std::string& path);

/// A map of one group 'A' with one mode, leave rate λ, and P(mode 1) = `probability` at `stamp`.
MapContent TwoStateContent(double leave_rate_per_s, double probability, Stamp stamp);

/// A report on a version, without evidence; the uuid ends in `number`, and
/// reports of different numbers begin at different times.
ShiftReport EmptyReport(const CommitResult& version, const std::string& area, int number);

/// A visit of 'A' with log-likelihood `absent` and `mode`.
VisitEvidence TwoStateEvidence(Stamp begin, Stamp end, double absent, double mode);

/// The time `seconds` after an arbitrary origin.
Stamp At(double seconds);

}  // namespace shiftmap::testing
