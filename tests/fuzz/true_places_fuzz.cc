// SPDX-License-Identifier: Apache-2.0
//
// Reads the input as a table of where landmarks truly stand.
#include "proto/core/check.h"
#include "tests/fuzz/fuzz_file.h"
#include "tests/fuzz/fuzz_target.h"
#include "tools/eval/map_error.h"

namespace shiftmap::testing {

std::vector<std::string> FuzzSeeds() {
  return {"",
          "signature,mode,x_m,y_m\nL01,1,1.5,-2\nL02,2,1e308,5e-324\r\n\n",
          "y_m,signature,x_m\n0,\"a, \"\"b\"\"\",1\n",
          "signature,mode,x_m,y_m\nL01,1,nan,inf\n",
          "signature,x_m,y_m\n,,\n"};
}

void RunFuzzInput(std::string_view bytes) {
  const auto places = ReadTruePlaces(FuzzFile(bytes));
  if (!places.ok()) return;
  for (const TruePlace& place : *places) {
    SHIFTMAP_CHECK(place.p_truth.allFinite(), "a place is not finite");
  }
}

}  // namespace shiftmap::testing
