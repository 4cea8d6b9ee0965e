// SPDX-License-Identifier: Apache-2.0
//
// Runs a target under libFuzzer, which also gets the target's seeds, unless it is to run files.
#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/fuzz/fuzz_target.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

std::string WrittenSeeds() {
  static const TempDir folder;
  int number = 0;
  for (const std::string& seed : FuzzSeeds()) {
    WriteFile(folder.File("seed-" + std::to_string(number++)), seed);
  }
  return folder.path();
}

}  // namespace
}  // namespace shiftmap::testing

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  static std::vector<char*> arguments(*argv, *argv + *argc);
  const auto is_file = [](const char* argument) {
    return argument[0] != '-' && std::filesystem::is_regular_file(argument);
  };
  if (std::any_of(arguments.begin() + 1, arguments.end(), is_file)) return 0;
  static std::string seeds = shiftmap::testing::WrittenSeeds();
  arguments.push_back(seeds.data());
  *argc = static_cast<int>(arguments.size());
  arguments.push_back(nullptr);
  *argv = arguments.data();
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const unsigned char* bytes, std::size_t size) {
  shiftmap::testing::RunFuzzInput({reinterpret_cast<const char*>(bytes), size});
  return 0;
}
