// SPDX-License-Identifier: Apache-2.0
//
// What a command is made of. The command-line library ends here: no header that others include
// names it.
#pragma once

#include <CLI/CLI.hpp>

#include "mapstore/cli/command.h"

namespace shiftmap {

struct Command::State {
  CLI::App* parser = nullptr;
  CLI::Option* last = nullptr;
  CommonOptions* common = nullptr;
  Body body;
  std::vector<std::function<std::string()>> checks;
};

}  // namespace shiftmap
