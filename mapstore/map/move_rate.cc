// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/move_rate.h"

namespace shiftmap {

double MoveRate(const ModeChain& chain) {
  if (chain.uniform()) return chain.leave_rate_per_s();
  return -chain.stationary().dot(chain.rate_matrix().diagonal());
}

}  // namespace shiftmap
