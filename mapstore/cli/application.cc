// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/application.h"

#include <algorithm>
#include <cctype>
#include <csignal>
#include <iostream>
#include <new>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <string_view>
#include <utility>

#include "mapstore/cli/internal/application_state.h"
#include "mapstore/cli/internal/command_state.h"
#include "mapstore/cli/internal/logging.h"
#include "mapstore/cli/internal/site_config.h"
#include "mapstore/cli/internal/watch.h"
#include "mapstore/cli/version.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/nearest_name.h"

namespace shiftmap {
namespace {

// Thrown while arguments are parsed, beside what the parser itself throws.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

std::string OneLine(std::string_view text) {
  return InertLine(text.substr(0, text.find_last_not_of('\n') + 1));
}

std::string ErrorJson(const std::string& message, ExitCode code) {
  return JsonText(Json{{"error", message}, {"exit_code", static_cast<int>(code)}});
}

constexpr const char* kCompletion = "--completion";
constexpr const char* kShowConfig = "--show-config";

void AddCommonOptions(CLI::App* parser, CommonOptions* common, AllowedValues* allowed) {
  parser->set_help_flag("-h,--help", "Print this help and exit");
  parser->set_version_flag("--version", parser->get_name() + " " + SoftwareVersion());
  parser->add_flag("--json", common->json, "Print one JSON document on standard output");
  parser->add_flag("--quiet", common->quiet, "No progress, and only errors on standard error");
  CLI::Option* const log_level =
      parser->add_option("--log-level", common->log_level, "Least level that is logged")
          ->capture_default_str();
  Allow({"trace", "debug", "info", "warning", "error", "off"}, log_level, allowed);
  parser->add_option("--config", common->config, "Read options from this TOML file");
  parser->add_flag(kShowConfig)
      ->description(
          "Print what holds for each option of the command and where it comes from, and exit");
}

bool IsGiven(const CLI::Option& option, std::span<const std::string> arguments) {
  return std::any_of(arguments.begin(), arguments.end(), [&](const std::string& argument) {
    const std::string name = argument.substr(0, argument.find('='));
    return name.starts_with("--") && option.check_name(name);
  });
}

// Of a flag, also where the arguments are not parsed.
bool Has(std::span<const std::string> arguments, std::string_view flag) {
  return std::find(arguments.begin(), arguments.end(), flag) != arguments.end();
}

std::string WithoutPrefix(const std::string& program) {
  constexpr std::string_view kPrefix = "shiftmap-";
  return program.starts_with(kPrefix) ? program.substr(kPrefix.size()) : program;
}

std::string ConfigPath(std::span<const std::string> arguments) {
  constexpr std::string_view kName = "--config";
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    if (arguments[i] == kName && i + 1 < arguments.size()) return arguments[i + 1];
    if (arguments[i].starts_with("--config=")) return arguments[i].substr(kName.size() + 1);
  }
  return "";
}

}  // namespace

Application::State::State(std::string program_name, std::string description)
    : program(std::move(program_name)),
      site_file_program(WithoutPrefix(program)),
      parser(std::move(description), program) {
  AddCommonOptions(&parser, &common, &allowed);
  Allow({"bash", "zsh"},
        parser.add_option(kCompletion, "Print a script by which a shell completes words, and exit"),
        &allowed);
}

Command* Application::State::Select(std::span<const std::string> arguments) const {
  for (const std::string& argument : arguments) {
    for (const auto& command : commands) {
      if (command->state_->parser != &parser && command->state_->parser->get_name() == argument) {
        return command.get();
      }
    }
  }
  const bool nameless = commands.size() == 1 && commands.front()->state_->parser == &parser;
  return nameless ? commands.front().get() : nullptr;
}

ReadingProgram Application::State::Reader() const {
  ReadingProgram reader;
  reader.name = site_file_program;
  for (const auto& command : commands) reader.commands.push_back(KeysOf(*command));
  return reader;
}

ReadingProgram::ReadingCommand Application::State::KeysOf(const Command& command) const {
  const CLI::App& section = *command.state_->parser;
  ReadingProgram::ReadingCommand reading;
  if (&section != &parser) reading.name = section.get_name();
  for (const CLI::Option* option : section.get_options()) {
    for (const std::string& name : option->get_lnames()) {
      const bool key = option != section.get_version_ptr() && name != "help" && name != "config" &&
                       name != "completion" && name != "show-config";
      if (key) reading.keys.push_back(name);
    }
  }
  return reading;
}

StatusOr<SiteConfig> Application::State::ReadSiteConfig(
    std::span<const std::string> arguments) const {
  std::string source;
  SHIFTMAP_ASSIGN_OR_RETURN(SiteConfig config,
                            SiteConfig::Read(SiteConfig::FindFile(ConfigPath(arguments), &source)));
  if (checks_site_file) SHIFTMAP_RETURN_IF_ERROR(config.Check(Reader()));
  return config;
}

std::vector<std::string> Application::State::ConfigArguments(
    const Command& command, std::span<const std::string> arguments) const {
  StatusOr<SiteConfig> config = ReadSiteConfig(arguments);
  if (!config.ok()) throw UsageError(Message(config.status()));
  std::vector<std::string> added;
  for (const Setting& setting : config->SettingsOf(Reader(), KeysOf(command))) {
    const std::string name = "--" + setting.key;
    const CLI::Option* const option = command.state_->parser->get_option_no_throw(name);
    if (option == nullptr || IsGiven(*option, arguments)) continue;
    const std::set<CLI::Option*> others = option->get_excludes();
    const bool excluded = std::any_of(others.begin(), others.end(), [&](const CLI::Option* other) {
      return IsGiven(*other, arguments);
    });
    if (excluded) continue;
    for (const std::string& value : setting.values) {
      // The parser would take the next word for the value.
      if (value.empty()) {
        throw UsageError(fmt::format("{}: {}: expected a value", setting.source, setting.key));
      }
      added.push_back(name + "=" + value);
    }
  }
  return added;
}

std::vector<CompletedCommand> Application::State::Completed() const {
  const auto completed = [this](const CLI::App& section) {
    CompletedCommand result;
    result.help = section.get_description();
    for (const CLI::Option* option : section.get_options()) {
      CompletedCommand::Argument argument = {"", option->get_description(), true, {}};
      if (!option->get_lnames().empty()) argument.name = "--" + option->get_lnames().front();
      argument.takes_value = option->get_items_expected_max() > 0;
      const auto values = allowed.find(option);
      if (values != allowed.end()) argument.values = values->second;
      result.arguments.push_back(std::move(argument));
    }
    return result;
  };
  std::vector<CompletedCommand> all = {completed(parser)};
  for (const auto& command : commands) {
    if (command->state_->parser == &parser) continue;
    all.push_back(completed(*command->state_->parser));
    all.back().name = command->state_->parser->get_name();
  }
  return all;
}

std::vector<std::string> Application::State::CommandNames() const {
  std::vector<std::string> names;
  for (const auto& command : commands) names.push_back(command->state_->parser->get_name());
  return names;
}

// The parser's own message would name a mistyped option last, after those that are missing.
void Application::State::RefuseUnknownOptions(std::span<const std::string> arguments,
                                              const Command* command) const {
  const CLI::App& section = command != nullptr ? *command->state_->parser : parser;
  bool is_value = false;
  for (const std::string& argument : arguments) {
    if (argument == "--") return;
    const std::string name = argument.substr(0, argument.find('='));
    const bool named = name.size() > 1 && name.front() == '-' &&
                       std::isdigit(static_cast<unsigned char>(name[1])) == 0 && name[1] != '.';
    if (std::exchange(is_value, false) || !named) continue;
    const std::string known = name[1] != '-' ? name.substr(0, 2) : name;
    const CLI::Option* option = section.get_option_no_throw(known);
    if (option == nullptr) option = parser.get_option_no_throw(known);
    if (option != nullptr) {
      const bool takes_value = option->get_items_expected_min() > 0;
      // The parser would take the next word for the value.
      if (takes_value && name[1] == '-' && argument.size() == name.size() + 1) {
        throw UsageError(fmt::format("{}: expected a value after '='", name));
      }
      is_value = takes_value && name.size() == argument.size();
      continue;
    }
    std::vector<std::string> names;
    for (const CLI::Option* candidate : section.get_options()) {
      for (const std::string& long_name : candidate->get_lnames())
        names.push_back("--" + long_name);
    }
    throw UsageError(fmt::format("no option '{}'{}", name, DidYouMean(name, names)));
  }
}

void Application::State::Parse(std::vector<std::string> arguments, const Command* command) {
  const bool help =
      std::any_of(arguments.begin(), arguments.end(), [](const std::string& argument) {
        return argument == "--help" || argument == "-h";
      });
  if (command == nullptr) {
    if (arguments.empty()) throw UsageError("a command is required");
    if (!arguments.front().starts_with('-')) {
      throw UsageError(fmt::format("unknown command '{}'{}",
                                   arguments.front(),
                                   DidYouMean(arguments.front(), CommandNames())));
    }
  }
  if (!help && (command == nullptr || !command->state_->parser->get_allow_extras())) {
    RefuseUnknownOptions(arguments, command);
  }
  if (command != nullptr && !help) {
    const std::vector<std::string> added = ConfigArguments(*command, arguments);
    const auto name =
        std::find(arguments.begin(), arguments.end(), command->state_->parser->get_name());
    arguments.insert(
        name == arguments.end() ? arguments.begin() : std::next(name), added.begin(), added.end());
  }
  if (command != nullptr) command->LetListsTakeSeveral();
  std::reverse(arguments.begin(), arguments.end());  // The order that the parser pops them in.
  parser.parse(std::move(arguments));
}

bool Application::State::IsNamed(const Command* command) const {
  return command != nullptr && command->state_->parser != &parser;
}

ExitCode Application::State::Usage(const std::string& message,
                                   const Command* command,
                                   std::span<const std::string> arguments,
                                   std::ostream* out,
                                   std::ostream* err) const {
  const std::string name = IsNamed(command) ? " " + command->state_->parser->get_name() : "";
  const std::string line = OneLine(message);
  const char* const hint = line.ends_with('?') ? " Try" : "; try";
  *err << fmt::format("{}: {}{} '{}{} --help'\n", program, line, hint, program, name);
  // The arguments may not have been parsed up to --json.
  if (Has(arguments, "--json")) *out << ErrorJson(OneLine(message), ExitCode::kUsage);
  return ExitCode::kUsage;
}

ExitCode Application::State::Execute(const Command& command, std::ostream* out, std::ostream* err) {
  const ScopedLogging logging(program, common, err);
  const TextStyle style = out == &std::cout ? StandardOutputStyle() : TextStyle();
  if (!common.watch_s) return RunBody(command, style, out, err);
  return Watch(*common.watch_s, common.json ? TextStyle() : style, out, [&](std::ostream* once) {
    for (const auto& refresh : command.state_->refresh) refresh();
    return RunBody(command, style, once, err);
  });
}

ExitCode Application::State::RunBody(const Command& command,
                                     const TextStyle& style,
                                     std::ostream* out,
                                     std::ostream* err) const {
  Context context(common, err, style);
  Status status = OkStatus();
  try {
    status = command.state_->body(context);
  } catch (const std::bad_alloc&) {
    status = Internal("out of memory");
  } catch (const std::exception& error) {
    status = Internal("unexpected error: {}", error.what());
  }
  ExitCode code = ExitCodeFor(status);
  if (!status.ok()) *err << program << ": " << OneLine(Message(status)) << '\n';
  if (code == ExitCode::kDone) code = context.done_code();
  if (context.reported()) {
    *out << context.output();
  } else if (common.json) {
    *out << (status.ok() ? JsonText(Json::object()) : ErrorJson(Message(status), code));
  }
  if (out->flush() || !status.ok()) return code;
  const bool wrote = command.state_->writes && !context.dry_run();
  if (!wrote && !context.has_effect()) {
    *err << program << ": standard output: cannot be written\n";
    return ExitCode::kTemporary;
  }
  // Done: to try again would do it twice.
  *err << fmt::format(
      "{}: standard output: cannot be written, but it is done: {}\n", program, context.summary());
  return ExitCode::kAttention;
}

// Without what the command needs to run: nothing is parsed but what says how to print.
ExitCode Application::State::ShowConfig(const Command* command,
                                        std::ostream* out,
                                        std::ostream* err) {
  if (const auto config = ReadSiteConfig(run_arguments); !config.ok()) {
    return Usage(Message(config.status()), command, run_arguments, out, err);
  }
  common.json = Has(run_arguments, "--json");
  common.config = ConfigPath(run_arguments);
  auto state = std::make_unique<Command::State>();
  state->body = [&](Context& context) {
    const std::string name = IsNamed(command) ? command->state_->parser->get_name() : "";
    return ReportConfig(name, run_arguments, context);
  };
  const TextStyle style = out == &std::cout ? StandardOutputStyle() : TextStyle();
  return RunBody(Command(std::move(state)), style, out, err);
}

Application::Application(std::string program, std::string description)
    : state_(std::make_unique<State>(std::move(program), std::move(description))) {}

Application::~Application() = default;

Command& Application::AddCommand(const std::string& name,
                                 const std::string& description,
                                 Command::Body body) {
  auto command_state = std::make_unique<Command::State>();
  command_state->parser = &state_->parser;
  if (!name.empty()) {
    command_state->parser = state_->parser.add_subcommand(name, description);
    AddCommonOptions(command_state->parser, &state_->common, &state_->allowed);
    state_->parser.require_subcommand(1);
  }
  command_state->common = &state_->common;
  command_state->allowed = &state_->allowed;
  command_state->body = std::move(body);
  state_->commands.push_back(std::unique_ptr<Command>(new Command(std::move(command_state))));
  return *state_->commands.back();
}

void Application::ReadSiteFileOf(const std::string& program) {
  state_->site_file_program = program;
  state_->checks_site_file = false;
}

ExitCode Application::Run(const std::vector<std::string>& arguments,
                          std::ostream* out,
                          std::ostream* err) {
  if (arguments.size() == 2 && arguments.front() == kCompletion) {
    if (arguments.back() == "bash" || arguments.back() == "zsh") {
      *out << (arguments.back() == "bash" ? BashCompletion : ZshCompletion)(state_->program,
                                                                            state_->Completed());
      return ExitCode::kDone;
    }
  }
  const Command* command = state_->Select(arguments);
  state_->run_arguments = arguments;
  if (Has(arguments, kShowConfig)) return state_->ShowConfig(command, out, err);
  try {
    state_->Parse(arguments, command);
  } catch (const CLI::CallForHelp&) {
    *out << (state_->IsNamed(command) ? command->state_->parser->help(state_->program)
                                      : state_->parser.help());
    return ExitCode::kDone;
  } catch (const CLI::CallForVersion&) {
    *out << state_->program << ' ' << SoftwareVersion() << '\n';
    return ExitCode::kDone;
  } catch (const std::bad_alloc&) {
    *err << state_->program << ": out of memory\n";
    return ExitCode::kInternal;
  } catch (const std::exception& error) {
    return state_->Usage(error.what(), command, arguments, out, err);
  }
  if (command == nullptr) {
    return state_->Usage("a command is required", command, arguments, out, err);
  }
  for (const auto& check : command->state_->checks) {
    if (const std::string message = check(); !message.empty()) {
      return state_->Usage(message, command, arguments, out, err);
    }
  }
  return state_->Execute(*command, out, err);
}

int Application::Main(int argc, const char* const* argv) {
  // A file that may not grow is a full disk, not a reason to die in the middle of a write.
  std::signal(SIGXFSZ, SIG_IGN);
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  return static_cast<int>(Run(arguments, &std::cout, &std::cerr));
}

}  // namespace shiftmap
