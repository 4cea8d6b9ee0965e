// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `ledger-years`.
void AddLedgerYearsExperiment(Application* application);

}  // namespace shiftmap
