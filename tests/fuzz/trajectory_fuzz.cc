// SPDX-License-Identifier: Apache-2.0
//
// Reads the input as a TUM trajectory. One that is accepted can be interpolated, and survives
// writing.
#include "mapstore/run/trajectory.h"

#include "proto/core/check.h"
#include "tests/fuzz/fuzz_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace shiftmap::testing {

std::vector<std::string> FuzzSeeds() {
  return {"",
          "# t x y z qx qy qz qw\n1.5 0 0 0 0 0 0 1\n2.5 1 2 0 0 0 0.6 0.8\n",
          "0 1e308 -1e308 0 0 0 1 0\n9.2e9 -1e308 1e308 0 0 0 1e-300 1e-300\n",
          "-9.2e9 0 0 0 0 0 0 1\r\n9.2e9 0 0 0 0 0 0 1\n",
          "1 0 0 0 0 0 1e300 1e300\n1 0 0 0 0 0 0 0\n",
          "1e300 0 0 0 0 0 0 1\n",
          "nan 0 0 0 0 0 0 1\n1 inf 0 0 0 0 0 1\n"};
}

void RunFuzzInput(std::string_view bytes) {
  const auto trajectory = ReadTum(FuzzFile(bytes));
  if (!trajectory.ok()) return;
  for (std::size_t i = 0; i < trajectory->size(); ++i) {
    const StampedPose& pose = (*trajectory)[i];
    SHIFTMAP_CHECK(i == 0 || (*trajectory)[i - 1].stamp <= pose.stamp, "pose {} out of order", i);
    SHIFTMAP_CHECK(pose.T_map_vehicle.translation().allFinite(), "pose {} is not finite", i);
    Interpolate(*trajectory, pose.stamp + std::chrono::nanoseconds(1), std::chrono::hours(1));
  }
  const std::string path = FuzzFile("");
  const Status written = WriteTum(*trajectory, path);
  SHIFTMAP_CHECK(written.ok(), "{}", Message(written));
  const auto again = ReadTum(path);
  SHIFTMAP_CHECK(again.ok() && again->size() == trajectory->size(), "other poses were written");
}

}  // namespace shiftmap::testing
