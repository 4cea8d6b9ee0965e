// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace shiftmap {

/// What a shell may complete in one command of a program.
struct CompletedCommand {
  /// An option, or a positional argument.
  struct Argument {
    std::string name;  ///< Of an option with its dashes; empty: a positional argument.
    std::string help;
    bool takes_value = true;
    std::vector<std::string> values;  ///< The only ones there are; empty: others, as a file's name.
  };
  std::string name;  ///< Empty: what stands before a command, or the only one of the program.
  std::string help;
  std::vector<Argument> arguments;
};

/// A script that completes a program's commands, options and values.
/// @param commands  The nameless one first.
std::string BashCompletion(const std::string& program,
                           const std::vector<CompletedCommand>& commands);
std::string ZshCompletion(const std::string& program,
                          const std::vector<CompletedCommand>& commands);

}  // namespace shiftmap
