// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/cli/config_file.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The commands of the program that reads a site file, with the keys of their options.
struct ReadingProgram {
  struct ReadingCommand {
    std::string name;  ///< Empty: the program does one thing.
    std::vector<std::string> keys;
  };
  std::string name;  ///< As a table has it: without `shiftmap-`.
  std::vector<ReadingCommand> commands;
};

/// The values that hold for an option, and where they come from.
struct Setting {
  std::string key;
  std::vector<std::string> values;
  std::string source;  ///< `<file>:<line>`, or the name of an environment variable.
};

/// The configuration that every command of every program reads: a site file and the environment.
///
/// A table of the file is named after a command, after a program (with or without `shiftmap-`), or
/// `program.command`. The closer
/// one wins: command, program, top; and the environment over all of the file.
class SiteConfig {
 public:
  /// Where the file is: `given`, else SHIFTMAP_CONFIG in the environment, else
  /// /etc/shiftmap/shiftmap.toml if that exists, else nowhere (empty).
  /// @param source  Gets why: "command line", the variable's name, or "default".
  static std::string FindFile(const std::string& given, std::string* source);

  /// @param path  Empty: there is no file.
  /// Errors: as ReadConfigFile.
  static StatusOr<SiteConfig> Read(const std::string& path);

  /// Whether the program can read all that is meant for it. A key in the table of another program
  /// is that program's to check.
  /// Errors: kInvalidArgument with file and line, and the nearest name there is.
  Status Check(const ReadingProgram& program) const;

  /// What holds for the options of a command, by key.
  std::vector<Setting> SettingsOf(const ReadingProgram& program,
                                  const ReadingProgram::ReadingCommand& command) const;

  /// Tables of the file that only other programs read.
  std::vector<std::string> TablesOfOthers(const ReadingProgram& program) const;

 private:
  SiteConfig(std::string path, std::vector<ConfigEntry> entries)
      : path_(std::move(path)), entries_(std::move(entries)) {}

  Status CheckEntry(const ReadingProgram& program, const ConfigEntry& entry) const;
  Status UnknownKey(const ConfigEntry& entry, const std::vector<std::string>& known) const;

  std::string path_;
  std::vector<ConfigEntry> entries_;
};

}  // namespace shiftmap
