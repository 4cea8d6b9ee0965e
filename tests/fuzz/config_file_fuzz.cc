// SPDX-License-Identifier: Apache-2.0
//
// Reads the input as a configuration file.
#include "mapstore/cli/config_file.h"

#include "proto/core/check.h"
#include "tests/fuzz/fuzz_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace shiftmap::testing {

std::vector<std::string> FuzzSeeds() {
  return {"",
          "store = 'maps.db'\nmax_range_m = 8.5\nquiet = true\n[build]\nthreads = 2\n",
          "a = [1, 2.0, 'three', true]\nb = [[1]]\nc = {d = 1}\n[e.f]\ng = 1979-05-27T07:32:00Z\n",
          "[[x]]\ny = 0x7fffffffffffffff\nz = -9223372036854775808\ninf = inf\nnan = nan\n",
          "k = \"\"\"\nmany\nlines \\u00e9 \\U0001F600\"\"\"\n",
          "big = 1e308\nsmall = 5e-324\n\"\" = 1\n'quoted key' = ''\n",
          "a = " + std::string(300, '[')};
}

void RunFuzzInput(std::string_view bytes) {
  const auto entries = ReadConfigFile(FuzzFile(bytes));
  if (!entries.ok()) {
    SHIFTMAP_CHECK(!Message(entries.status()).empty(), "refused without a reason");
    return;
  }
  for (const ConfigEntry& entry : *entries) {
    SHIFTMAP_CHECK(entry.key.find('_') == std::string::npos, "key '{}'", entry.key);
  }
}

}  // namespace shiftmap::testing
