// SPDX-License-Identifier: Apache-2.0
//
// What a command is made of. The command-line library ends here: no header that others include
// names it.
#pragma once

#include <CLI/CLI.hpp>
#include <map>
#include <string>
#include <vector>

#include "mapstore/cli/command.h"

namespace shiftmap {

/// Of an option that takes one of these values; refuses another with the nearest of them.
CLI::Validator OneOfThese(const std::vector<std::string>& allowed);

struct Command::State {
  CLI::App* parser = nullptr;
  CLI::Option* last = nullptr;
  CommonOptions* common = nullptr;
  bool writes = false;
  std::map<const CLI::Option*, std::vector<std::string>> allowed;  // Of options that have a list.
  std::vector<CLI::Option*> lists;  // Options that are given several times.
  Body body;
  std::vector<std::function<void()>> refresh;  // Reads relative times anew.
  std::vector<std::function<std::string()>> checks;
};

}  // namespace shiftmap
