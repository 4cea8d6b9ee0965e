// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/snapshot_info.h"

#include <fmt/format.h>

namespace shiftmap {

std::string SignedText(const SnapshotInfo& snapshot) {
  return fmt::format("shiftmap-snapshot\n{}\n{}\n{}\n{}\n{}\n",
                     snapshot.area,
                     snapshot.version.value(),
                     snapshot.content_hash,
                     snapshot.ledger_sequence.value(),
                     snapshot.sha256);
}

}  // namespace shiftmap
