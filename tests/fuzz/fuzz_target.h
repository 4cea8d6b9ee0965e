// SPDX-License-Identifier: Apache-2.0
//
// A fuzz target is one source that defines these two. libfuzzer_main.cc runs it under libFuzzer,
// seeded_main.cc with any compiler.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace shiftmap::testing {

/// Inputs to start from: valid ones, and extremes that pass validation.
std::vector<std::string> FuzzSeeds();

/// Runs one input; aborts if the code under test does what it must not.
void RunFuzzInput(std::string_view bytes);

}  // namespace shiftmap::testing
