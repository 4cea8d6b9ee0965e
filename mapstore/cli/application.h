// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include "mapstore/cli/command.h"
#include "mapstore/cli/exit_codes.h"

namespace shiftmap {

/// A program with commands, each with --help, --version, --json, --quiet, --log-level and --config
/// FILE.toml.
///
/// A result goes to standard output: text, or with --json exactly one document a run of the body
/// (for an error that reported none, `{"error": message, "exit_code": n}`). Everything else goes to
/// standard error; an error is one line, `<program>: <message>`.
///
/// Options on the command line win over the environment, and that over the site file: --config,
/// else SHIFTMAP_CONFIG, else /etc/shiftmap/shiftmap.toml (mapstore/cli/README.md). A name that is
/// none is a usage error with the nearest one there is.
class Application {
 public:
  Application(std::string program, std::string description);
  ~Application();
  Application(const Application&) = delete;
  Application& operator=(const Application&) = delete;

  /// @param name  Empty for a program that does one thing: its options follow its name.
  Command& AddCommand(const std::string& name, const std::string& description, Command::Body body);

  /// Adds `config`, which prints what holds for each option of each command, and why.
  void AddConfigCommand();

  /// For a binary that runs some commands of another program: it reads that program's tables of the
  /// site file, which that program has checked.
  /// @param program  As in ProgramCommands.
  void ReadSiteFileOf(const std::string& program);

  /// Runs what the arguments (without the program's name) ask for; call once.
  ExitCode Run(const std::vector<std::string>& arguments, std::ostream* out, std::ostream* err);

  /// Runs on the process' own arguments and streams; what main() returns.
  int Main(int argc, const char* const* argv);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace shiftmap
