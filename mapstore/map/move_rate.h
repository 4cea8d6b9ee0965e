// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/map/mode_chain.h"

namespace shiftmap {

/// How often a landmark moves in the long run: Σ π_k q_k over the states of its chain, with q_k the
/// rate of leaving state k and π ModeChain::stationary(). A state that it is hardly ever in, as
/// `absent` mostly, counts for little. Of a uniform chain ModeChain::leave_rate_per_s(). [1/s]
double MoveRate(const ModeChain& chain);

}  // namespace shiftmap
