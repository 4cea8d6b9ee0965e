// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "mapstore/cli/context.h"

namespace shiftmap::testing {

using Arguments = std::vector<std::string>;

/// By how much programs may be slower than they are built for users.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr int kSlowdown = 10;
#else
inline constexpr int kSlowdown = 1;
#endif

struct CommandResult {
  int exit_code = 0;  ///< 128 + signal if a signal ended it.
  std::string out;
  std::string err;
};

struct CommandOptions {
  std::string input{};                     ///< What it reads on standard input, through a pipe.
  std::vector<std::string> environment{};  ///< `NAME=value`, beside what this process has.
  std::string output{};                    ///< Where standard output goes; empty: to `out`.
  bool unprivileged = false;  ///< As a user without rights over others' files, even under root.
};

/// Runs one of the project's programs, e.g. "shiftmap-inspect", to its end.
CommandResult RunCommand(const std::string& program,
                         const Arguments& arguments,
                         const CommandOptions& options = {});

/// Runs with --json; expects exit code 0 and one document on standard output, and returns it.
Json RunForJson(const std::string& program,
                const Arguments& arguments,
                const CommandOptions& options = {});

/// Runs twice, without and with --json. Expects both times the exit code and exactly one line on
/// standard error, `<program>: <message>` with `object` in it; on standard output nothing without
/// --json, and with it one document that says the same.
void ExpectError(const std::string& program,
                 const Arguments& arguments,
                 int exit_code,
                 const std::string& object,
                 const CommandOptions& options = {});

/// Number of lines; the last one need not end in a newline.
int CountLines(const std::string& text);

}  // namespace shiftmap::testing
