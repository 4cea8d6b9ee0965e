// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <ostream>
#include <span>
#include <string>
#include <vector>

#include "mapstore/cli/application.h"
#include "mapstore/cli/internal/command_state.h"
#include "mapstore/cli/internal/completion.h"
#include "mapstore/cli/internal/site_config.h"
#include "mapstore/cli/text_style.h"

namespace shiftmap {

struct Application::State {
  State(std::string program_name, std::string description);

  /// The command that the arguments name, the nameless one, or null.
  Command* Select(std::span<const std::string> arguments) const;

  /// Whether it is a command with a name, and not what a program does without one.
  bool IsNamed(const Command* command) const;

  /// This program for a site file.
  ReadingProgram Reader() const;
  ReadingProgram::ReadingCommand KeysOf(const Command& command) const;

  /// The configuration that the arguments name, checked.
  StatusOr<SiteConfig> ReadSiteConfig(std::span<const std::string> arguments) const;

  /// Options of the configuration for `command` that the command line does not have.
  std::vector<std::string> ConfigArguments(const Command& command,
                                           std::span<const std::string> arguments) const;

  std::vector<std::string> CommandNames() const;
  void RefuseUnknownOptions(std::span<const std::string> arguments, const Command* command) const;
  void Parse(std::vector<std::string> arguments, const Command* command);
  ExitCode Usage(const std::string& message,
                 const Command* command,
                 std::span<const std::string> arguments,
                 std::ostream* out,
                 std::ostream* err) const;
  ExitCode Execute(const Command& command, std::ostream* out, std::ostream* err);
  ExitCode RunBody(const Command& command,
                   const TextStyle& style,
                   std::ostream* out,
                   std::ostream* err) const;

  /// What --show-config prints of a command; null: of all.
  ExitCode ShowConfig(const Command* command, std::ostream* out, std::ostream* err);

  /// What `config` prints.
  /// @param asked      The command it is about; empty: all.
  /// @param arguments  Those that the command would be given.
  Status ReportConfig(const std::string& asked,
                      std::span<const std::string> arguments,
                      Context& context) const;

  /// For shells: what stands before a command, and each command.
  std::vector<CompletedCommand> Completed() const;

  std::string program;
  std::string site_file_program;  ///< Whose tables of the site file it reads.
  bool checks_site_file = true;
  CommonOptions common;
  CLI::App parser;
  AllowedValues allowed;
  std::vector<std::unique_ptr<Command>> commands;
  std::vector<std::string> run_arguments;  ///< Of the run.
};

}  // namespace shiftmap
