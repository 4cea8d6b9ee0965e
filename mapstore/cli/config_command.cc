// SPDX-License-Identifier: Apache-2.0
//
// The command that prints the effective configuration.
#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "mapstore/cli/aligned_table.h"
#include "mapstore/cli/application.h"
#include "mapstore/cli/internal/application_state.h"
#include "mapstore/cli/internal/command_state.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/nearest_name.h"

namespace shiftmap {
namespace {

// What holds for an option of one or more commands.
struct Row {
  std::vector<std::string> commands;
  std::string key;
  std::string value;
  std::string source;
};

std::string Joined(const std::vector<std::string>& values) {
  std::string text;
  for (const std::string& value : values) text += (text.empty() ? "" : ", ") + value;
  return text;
}

// The values that the command line gives an option.
std::vector<std::string> Given(const CLI::Option& option, std::span<const std::string> arguments) {
  std::vector<std::string> values;
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    const std::size_t equals = arguments[i].find('=');
    const std::string name = arguments[i].substr(0, equals);
    if (!name.starts_with("--") || !option.check_name(name)) continue;
    if (equals != std::string::npos) {
      values.push_back(arguments[i].substr(equals + 1));
    } else if (option.get_items_expected_max() == 0) {
      values.emplace_back("true");
    } else if (i + 1 < arguments.size()) {
      values.push_back(arguments[i + 1]);
    }
  }
  return values;
}

// Commands for which the same holds share a row, in the order in which the options first come.
void Add(std::string command, Row row, std::vector<Row>* rows) {
  const auto found = std::find_if(rows->begin(), rows->end(), [&](const Row& other) {
    return other.key == row.key && other.value == row.value && other.source == row.source;
  });
  if (found != rows->end()) {
    found->commands.push_back(std::move(command));
    return;
  }
  row.commands.push_back(std::move(command));
  rows->push_back(std::move(row));
}

std::string CommandsText(const Row& row, std::size_t commands) {
  const bool all = row.commands.size() == commands && commands > 1;
  return all ? "all" : Joined(row.commands);
}

}  // namespace

Status Application::State::ReportConfig(const std::string& asked,
                                        std::span<const std::string> given,
                                        Context& context) const {
  std::string why;
  const std::string path = SiteConfig::FindFile(common.config, &why);
  SHIFTMAP_ASSIGN_OR_RETURN(const SiteConfig config, SiteConfig::Read(path));
  const ReadingProgram reader = Reader();
  SHIFTMAP_RETURN_IF_ERROR(config.Check(reader));
  std::vector<Row> rows;
  std::size_t looked_at = 0;
  for (const auto& command : commands) {
    const CLI::App& section = *command->state_->parser;
    const std::string name = section.get_name();
    if (section.get_allow_extras() || (!asked.empty() && asked != name)) continue;
    ++looked_at;
    const ReadingProgram::ReadingCommand keys = KeysOf(*command);
    std::map<std::string, Setting> settings;
    for (Setting& setting : config.SettingsOf(reader, keys)) {
      const std::string key = setting.key;
      settings.emplace(key, std::move(setting));
    }
    for (const std::string& key : keys.keys) {
      const CLI::Option& option = *section.get_option("--" + key);
      if (const auto values = Given(option, given); !values.empty()) {
        Add(name, {{}, key, Joined(values), "command line"}, &rows);
      } else if (const auto found = settings.find(key); found != settings.end()) {
        Add(name, {{}, key, Joined(found->second.values), found->second.source}, &rows);
      } else {
        Add(name, {{}, key, option.get_default_str(), "default"}, &rows);
      }
    }
  }
  Json list = Json::array();
  AlignedTable table({"key", "value", "from", "commands"});
  for (const Row& row : rows) {
    const bool set = row.source != "default";
    list.push_back({{"key", row.key},
                    {"value", !set && row.value.empty() ? Json(nullptr) : Json(row.value)},
                    {"source", row.source},
                    {"commands", row.commands}});
    table.AddRow(
        {row.key, row.value.empty() ? "-" : row.value, row.source, CommandsText(row, looked_at)},
        set ? Emphasis::kNone : Emphasis::kFaint);
  }
  const std::vector<std::string> others = config.TablesOfOthers(reader);
  std::string text = path.empty()
                         ? std::string("no configuration file\n")
                         : fmt::format("configuration '{}', named by: {}\n", InertLine(path), why);
  if (!others.empty()) {
    text += fmt::format("tables for other programs, which tell by --show-config: {}\n",
                        InertLine(Joined(others)));
  }
  context.Report({{"file", path.empty() ? Json(nullptr) : Json(path)},
                  {"file_source", path.empty() ? Json(nullptr) : Json(why)},
                  {"keys", list},
                  {"tables_of_other_programs", others}},
                 text + "\n" + table.ToString(context.style()));
  return OkStatus();
}

void Application::AddConfigCommand() {
  auto asked = std::make_shared<std::string>();
  State* const state = state_.get();
  Command& command = AddCommand(
      "config",
      "Print what holds for each option and where it comes from: default, site file and line, "
      "environment, or the command line that follows COMMAND",
      [asked, state](Context& context) {
        return state->ReportConfig(*asked, state->run_arguments, context);
      });
  command.Option("COMMAND", asked.get(), "Of one command only, with its options")
      .Check([asked, state] {
        const std::vector<std::string> names = state->CommandNames();
        const bool known = asked->empty() || (*asked != "config" &&
                                              std::count(names.begin(), names.end(), *asked) > 0);
        return known ? ""
                     : fmt::format("unknown command '{}'{}", *asked, DidYouMean(*asked, names));
      });
  command.state_->parser->allow_extras();
}

}  // namespace shiftmap
