// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/internal/completion.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <utility>

namespace shiftmap {
namespace {

using Argument = CompletedCommand::Argument;

std::string FunctionName(const std::string& program) {
  std::string name = "_" + program;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

std::vector<std::string> CommandNames(const std::vector<CompletedCommand>& commands) {
  std::vector<std::string> names;
  for (const CompletedCommand& command : commands) {
    if (!command.name.empty()) names.push_back(command.name);
  }
  return names;
}

// What may come where no option waits for its value.
std::vector<std::string> Words(const CompletedCommand& command) {
  std::vector<std::string> words;
  for (const Argument& argument : command.arguments) {
    if (!argument.name.empty()) words.push_back(argument.name);
    if (argument.name.empty()) {
      words.insert(words.end(), argument.values.begin(), argument.values.end());
    }
  }
  return words;
}

// Text in single quotes, in which zsh's `_arguments` reads `:`, `[` and `]` as text.
std::string ZshText(const std::string& text) {
  std::string quoted;
  for (const char c : text) {
    if (c == '\'') {
      quoted += "'\\''";
    } else {
      if (c == ':' || c == '[' || c == ']' || c == '\\') quoted += '\\';
      quoted += c;
    }
  }
  return quoted;
}

std::string ZshArgument(const Argument& argument) {
  const std::string action = argument.values.empty()
                                 ? std::string("_files")
                                 : fmt::format("({})", fmt::join(argument.values, " "));
  if (argument.name.empty()) return fmt::format("'*:{}:{}'", ZshText(argument.help), action);
  const std::string value = argument.takes_value ? fmt::format(":value:{}", action) : "";
  return fmt::format("'*{}[{}]{}'", argument.name, ZshText(argument.help), value);
}

std::string ZshArguments(const CompletedCommand& command) {
  std::string text = "_arguments";
  bool positional = false;
  for (const Argument& argument : command.arguments) {
    // `_arguments` takes one rest; those with values come first.
    if (argument.name.empty() && std::exchange(positional, true)) continue;
    text += " \\\n      " + ZshArgument(argument);
  }
  return text;
}

}  // namespace

std::string BashCompletion(const std::string& program,
                           const std::vector<CompletedCommand>& commands) {
  const std::string function = FunctionName(program);
  const std::vector<std::string> names = CommandNames(commands);
  std::string text = fmt::format(
      "# bash completion of {0}\n{1}() {{\n"
      "  local cur=${{COMP_WORDS[COMP_CWORD]}} prev=${{COMP_WORDS[COMP_CWORD - 1]}} command= i\n",
      program,
      function);
  if (!names.empty()) {
    text += fmt::format(
        "  for ((i = 1; i < COMP_CWORD; ++i)); do\n    case ${{COMP_WORDS[i]}} in\n"
        "      {}) command=${{COMP_WORDS[i]}}; break ;;\n    esac\n  done\n",
        fmt::join(names, " | "));
  }
  text += "  local words=\n  case \"$command $prev\" in\n";
  for (const CompletedCommand& command : commands) {
    std::vector<std::string> free;  // Options with any value.
    for (const Argument& argument : command.arguments) {
      if (argument.name.empty() || !argument.takes_value) continue;
      const std::string pattern = fmt::format("'{} {}'", command.name, argument.name);
      if (argument.values.empty()) {
        free.push_back(pattern);
      } else {
        text += fmt::format("    {}) words='{}' ;;\n", pattern, fmt::join(argument.values, " "));
      }
    }
    if (!free.empty()) text += fmt::format("    {}) ;;\n", fmt::join(free, " | "));
  }
  text += "    *)\n      case $command in\n";
  for (const CompletedCommand& command : commands) {
    std::vector<std::string> words = Words(command);
    if (command.name.empty()) words.insert(words.end(), names.begin(), names.end());
    text += fmt::format("        '{}') words='{}' ;;\n", command.name, fmt::join(words, " "));
  }
  text += fmt::format(
      "      esac\n      ;;\n  esac\n"
      "  mapfile -t COMPREPLY < <(compgen -W \"$words\" -- \"$cur\")\n}}\n"
      "complete -o default -F {} {}\n",
      function,
      program);
  return text;
}

std::string ZshCompletion(const std::string& program,
                          const std::vector<CompletedCommand>& commands) {
  std::string text = fmt::format("#compdef {}\n", program);
  std::string list;
  std::string cases;
  for (const CompletedCommand& command : commands) {
    if (command.name.empty()) continue;
    list += fmt::format("    '{}:{}'\n", command.name, ZshText(command.help));
    cases += fmt::format("    {})\n      {}\n      ;;\n", command.name, ZshArguments(command));
  }
  if (list.empty()) return text + ZshArguments(commands.front()) + "\n";
  text += fmt::format("local -a commands=(\n{}  )\n", list);
  text += "if ((CURRENT == 2)); then\n  _describe command commands\n  " +
          ZshArguments(commands.front()) + "\n  return\nfi\n";
  return text + "local command=$words[2]\nshift words\n((CURRENT--))\ncase $command in\n" + cases +
         "esac\n";
}

}  // namespace shiftmap
