// SPDX-License-Identifier: Apache-2.0
#include <cstdio>

#include "mapstore/cli/exit_codes.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/map_store.h"

int main() {
  const shiftmap::Se2 T_map_vehicle(1.0, 2.0, 0.5);
  const shiftmap::Se2 identity = T_map_vehicle * T_map_vehicle.Inverse();
  const auto store =
      shiftmap::MapStore::Open("/nonexistent/maps.db", shiftmap::MapStore::Access::kReadOnly);
  const bool ok = identity.translation().norm() < 1e-12 &&
                  shiftmap::ExitCodeFor(store.status()) == shiftmap::ExitCode::kNotFound;
  std::puts(ok ? "consumer: ok" : "consumer: FAILED");
  return ok ? 0 : 1;
}
