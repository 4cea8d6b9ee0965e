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

/// Of the options of a program that have a list, the values they take.
using AllowedValues = std::map<const CLI::Option*, std::vector<std::string>>;

/// Lets an option take one of these values only; another is refused with the nearest of them.
void Allow(const std::vector<std::string>& values, CLI::Option* option, AllowedValues* allowed);

struct Command::State {
  CLI::App* parser = nullptr;
  CLI::Option* last = nullptr;
  CommonOptions* common = nullptr;
  bool writes = false;
  AllowedValues* allowed = nullptr;  // Of the program.
  std::vector<CLI::Option*> lists;   // Options that are given several times.
  Body body;
  std::vector<std::function<void()>> refresh;  // Reads relative times anew.
  std::vector<std::function<std::string()>> checks;
};

}  // namespace shiftmap
