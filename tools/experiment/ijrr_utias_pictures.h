// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "tools/experiment/chart.h"
#include "tools/experiment/ijrr_utias.h"

namespace shiftmap {

/// IJRR figure 8: the true path, those of our mapper, of the tree search (in a window, if that is
/// what ran) and of the max-mixture, as far as they ran, and the surveyed landmarks with those that
/// the map has displaced.
/// @param rows  Of this case, all with the same displacement.
Chart DrawPaths(const UtiasCase& data, const std::vector<const IjrrUtiasRow*>& rows);

/// IJRR figure 11: the same of our mapper, of EM and of the tree search, with the modes that each
/// of them created.
Chart DrawCreatedModes(const UtiasCase& data, const std::vector<const IjrrUtiasRow*>& rows);

}  // namespace shiftmap
