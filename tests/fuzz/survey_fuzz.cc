// SPDX-License-Identifier: Apache-2.0
//
// Reads the input as a survey. One that is accepted is a valid map, whose numbers can be asked for.
#include "mapper/cli/survey_file.h"

#include "proto/core/check.h"
#include "tests/fuzz/fuzz_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace shiftmap::testing {

std::vector<std::string> FuzzSeeds() {
  const std::string header = "signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability\n";
  return {
      "",
      header,
      header + "L01,1,1,2,0.1,0.1,0.5\nL01,2,4,2,0.1,0.1,0.5\r\n# a comment\n\nL02,1,0,0,1,1,1\n",
      header + "L01,0,,,,,0.25\nL01,1,1,2,0.1,0.1,0.75\n",
      header + "L01,9223372036854775807,1e308,-1e308,1e150,1e150,1\n",
      header + "L01,1,5e-324,-0,1e-150,1e-150,5e-324\n",
      header + "\"a\"\"b, c\",1,1,2,0.1,0.1,1\n",
      header + "L01,1,nan,inf,0.1,0.1,1\n",
      header + "L01,0,,,,,1\n"};
}

void RunFuzzInput(std::string_view bytes) {
  const auto content = ReadSurvey(FuzzFile(bytes), StampFromSeconds(1.0e9), 1e-6);
  if (!content.ok()) return;
  const Status valid = ValidateMapContent(*content);
  SHIFTMAP_CHECK(valid.ok(), "an invalid map was read: {}", Message(valid));
  const MapSnapshot map("area", VersionNumber(1), ContentHash(*content), *content);
  for (const LandmarkGroup& group : map.groups()) {
    SHIFTMAP_CHECK(map.GroupIndex(group.signature) >= 0, "a group is not found");
  }
}

}  // namespace shiftmap::testing
