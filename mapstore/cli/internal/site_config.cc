// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/internal/site_config.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <string_view>
#include <utility>

#include "mapstore/cli/programs.h"
#include "mapstore/core/nearest_name.h"

namespace shiftmap {
namespace {

// Closeness of a command's own table; larger is closer.
constexpr int kOwnTable = 2;

constexpr const char* kVariable = "SHIFTMAP_CONFIG";
constexpr std::string_view kPrefix = "shiftmap-";
constexpr const char* kSiteFile = "/etc/shiftmap/shiftmap.toml";

using ReadingCommand = ReadingProgram::ReadingCommand;

bool Contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

const ReadingCommand* FindCommand(const ReadingProgram& program, const std::string& name) {
  for (const ReadingCommand& command : program.commands) {
    if (!command.name.empty() && command.name == name) return &command;
  }
  return nullptr;
}

std::vector<std::string> AllKeys(const ReadingProgram& program) {
  std::vector<std::string> keys;
  for (const ReadingCommand& command : program.commands) {
    keys.insert(keys.end(), command.keys.begin(), command.keys.end());
  }
  return keys;
}

// Programs other than the reading one that have such a command, or are called so.
std::vector<std::string> OthersWith(const ReadingProgram& reader, const std::string& command) {
  std::vector<std::string> programs;
  for (const ProgramCommands& program : AllPrograms()) {
    if (program.program != reader.name && Contains(program.commands, command)) {
      programs.push_back(program.program);
    }
  }
  return programs;
}

bool IsOtherProgram(const ReadingProgram& reader, const std::string& name) {
  const std::vector<ProgramCommands>& programs = AllPrograms();
  return name != reader.name &&
         std::any_of(programs.begin(), programs.end(), [&](const ProgramCommands& program) {
           return program.program == name;
         });
}

std::vector<std::string> AllTables(const ReadingProgram& reader) {
  std::vector<std::string> tables = {reader.name};
  for (const ReadingCommand& command : reader.commands) tables.push_back(command.name);
  for (const ProgramCommands& program : AllPrograms()) {
    tables.push_back(program.program);
    tables.insert(tables.end(), program.commands.begin(), program.commands.end());
  }
  return tables;
}

std::pair<std::string, std::string> SplitAtDot(const std::string& section) {
  const std::size_t dot = section.find('.');
  if (dot == std::string::npos) return {section, ""};
  return {section.substr(0, dot), section.substr(dot + 1)};
}

// How close a table is to a command: larger is closer, 0 the top, -1 not at all.
int Closeness(const ReadingProgram& program,
              const ReadingCommand& command,
              const std::string& section) {
  if (section.empty()) return 0;
  const auto [first, second] = SplitAtDot(section);
  if (first == program.name && second.empty()) return 1;
  const bool named = !command.name.empty();
  if (named && second.empty() && first == command.name) return kOwnTable;
  return named && first == program.name && second == command.name ? 3 : -1;
}

}  // namespace

std::string SiteConfig::FindFile(const std::string& given, std::string* source) {
  *source = "command line";
  if (!given.empty()) return given;
  *source = kVariable;
  const char* const variable = std::getenv(kVariable);
  if (variable != nullptr && *variable != '\0') return variable;
  *source = "default";
  std::error_code error;
  return std::filesystem::exists(kSiteFile, error) ? kSiteFile : "";
}

StatusOr<SiteConfig> SiteConfig::Read(const std::string& path) {
  if (path.empty()) return SiteConfig("", {});
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<ConfigEntry> entries, ReadConfigFile(path));
  // A program may be called in full: `server` is a key as well.
  for (ConfigEntry& entry : entries) {
    if (entry.section.starts_with(kPrefix)) entry.section.erase(0, kPrefix.size());
  }
  return SiteConfig(path, std::move(entries));
}

Status SiteConfig::Check(const ReadingProgram& program) const {
  for (const ConfigEntry& entry : entries_) {
    SHIFTMAP_RETURN_IF_ERROR(CheckEntry(program, entry));
  }
  return OkStatus();
}

Status SiteConfig::UnknownKey(const ConfigEntry& entry,
                              const std::vector<std::string>& known) const {
  const std::string table = entry.section.empty() ? "" : entry.section + ".";
  return InvalidArgument("config '{}:{}': unknown key '{}{}'{}",
                         path_,
                         entry.line,
                         table,
                         entry.key,
                         DidYouMean(entry.key, known));
}

Status SiteConfig::CheckEntry(const ReadingProgram& program, const ConfigEntry& entry) const {
  // A file that names another one would hide where a value comes from.
  const bool usable = entry.key != "config";
  const auto [first, second] = SplitAtDot(entry.section);
  if (first.empty()) {
    std::vector<std::string> known = SharedKeys();
    const std::vector<std::string> own = AllKeys(program);
    known.insert(known.end(), own.begin(), own.end());
    return usable && Contains(known, entry.key) ? OkStatus() : UnknownKey(entry, known);
  }
  if (IsOtherProgram(program, first)) return OkStatus();
  const bool own_table = first == program.name;
  if (own_table && second.empty()) {
    const std::vector<std::string> known = AllKeys(program);
    return usable && Contains(known, entry.key) ? OkStatus() : UnknownKey(entry, known);
  }
  const ReadingCommand* const command = FindCommand(program, own_table ? second : first);
  if (command != nullptr && (own_table || second.empty())) {
    if (usable && Contains(command->keys, entry.key)) return OkStatus();
    // Another program's command of that name may know it.
    if (usable && !own_table && !OthersWith(program, first).empty()) return OkStatus();
    return UnknownKey(entry, command->keys);
  }
  if (second.empty() && !OthersWith(program, first).empty()) return OkStatus();
  return InvalidArgument(
      "config '{}:{}': unknown table '{}': no command or program has this name{}",
      path_,
      entry.line,
      entry.section,
      DidYouMean(own_table ? second : first, AllTables(program)));
}

std::vector<Setting> SiteConfig::SettingsOf(const ReadingProgram& program,
                                            const ReadingCommand& command) const {
  struct Closest {
    Setting setting;
    int closeness = -1;
  };
  std::map<std::string, Closest> found;
  for (const ConfigEntry& entry : entries_) {
    if (!Contains(command.keys, entry.key)) continue;
    const int closeness = Closeness(program, command, entry.section);
    const int least = IsOfOwnTable(command.name, entry.key) ? kOwnTable : 0;
    if (closeness < least || closeness < found[entry.key].closeness) continue;
    found[entry.key] = {{entry.key, entry.values, fmt::format("{}:{}", path_, entry.line)},
                        closeness};
  }
  std::vector<Setting> settings;
  for (const std::string& key : command.keys) {
    if (IsOfOwnTable(command.name, key)) continue;
    const std::string variable = EnvironmentNameOf(key);
    const char* const value = variable.empty() ? nullptr : std::getenv(variable.c_str());
    if (value != nullptr && *value != '\0') found[key] = {{key, {value}, variable}, 0};
  }
  for (auto& [key, closest] : found) {
    if (!closest.setting.source.empty()) settings.push_back(std::move(closest.setting));
  }
  return settings;
}

std::vector<std::string> SiteConfig::TablesOfOthers(const ReadingProgram& program) const {
  std::vector<std::string> tables;
  for (const ConfigEntry& entry : entries_) {
    const auto [first, second] = SplitAtDot(entry.section);
    const bool own = first.empty() || first == program.name ||
                     (second.empty() && FindCommand(program, first) != nullptr);
    if (!own && !Contains(tables, entry.section)) tables.push_back(entry.section);
  }
  return tables;
}

}  // namespace shiftmap
