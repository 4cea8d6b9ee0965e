// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/command.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <system_error>
#include <type_traits>
#include <utility>

#include "mapstore/cli/internal/command_state.h"
#include "mapstore/cli/time_text.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/nearest_name.h"
#include "mapstore/core/parse_whole.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

bool IsPositional(const std::string& name) { return name.empty() || name.front() != '-'; }

template <typename Value>
struct HeldBy {
  using Type = Value;
};

template <typename Value>
struct HeldBy<std::optional<Value>> {
  using Type = Value;
};

std::string RefuseOtherThanFinite(const std::string& text) {
  double value = 0.0;
  if (!CLI::detail::lexical_cast(text, value)) return fmt::format("'{}' is no number", text);
  return std::isfinite(value) ? "" : fmt::format("Value {} is not finite", text);
}

template <typename Integer>
std::string RefuseOtherThanInteger(const std::string& text) {
  // The parser would take -1 for the largest number there is.
  if (std::is_unsigned_v<Integer> && text.starts_with('-')) {
    return fmt::format("Value {} is negative", text);
  }
  // CLI11 also reads hexadecimal and octal numbers, and clamps a number that is out of range.
  if (ParseWhole<Integer>(text.starts_with('+') ? text.substr(1) : text)) return "";
  const bool number = ParseWhole<double>(text).has_value();
  return fmt::format("'{}' is {}", text, number ? "no integer in range" : "no number");
}

// Nothing, or why it is no time.
std::string RefuseOtherThanTime(const std::string& text) {
  const StatusOr<Stamp> time = ParseTime(text, SystemNow());
  return time.ok() ? "" : Message(time.status());
}

// Whether two names are of one file, which need not exist.
bool IsSameFile(const std::string& a, const std::string& b) {
  if (b.empty()) return false;
  std::error_code error;
  if (std::filesystem::equivalent(a, b, error)) return true;
  const std::filesystem::path canonical = std::filesystem::weakly_canonical(a, error);
  return !error && canonical == std::filesystem::weakly_canonical(b, error) && !error;
}

// The shortest and the longest time between two repetitions. [s]
constexpr double kLeastWatchS = 0.1;
constexpr double kMostWatchS = 86'400.0;

}  // namespace

void Allow(const std::vector<std::string>& values, CLI::Option* option, AllowedValues* allowed) {
  const auto check = [values](const std::string& text) {
    if (std::find(values.begin(), values.end(), text) != values.end()) return std::string();
    return fmt::format(
        "'{}' is none of {}{}", text, fmt::join(values, ", "), DidYouMean(text, values));
  };
  option->check(CLI::Validator(check, fmt::format("{{{}}}", fmt::join(values, ",")), ""));
  (*allowed)[option] = values;
}

Command::Command(std::unique_ptr<State> state) : state_(std::move(state)) {}
Command::~Command() = default;

template <typename Value>
Command& Command::Option(const std::string& name, Value* value, const std::string& help) {
  using Held = typename HeldBy<Value>::Type;
  // A command whose --version names a map version leaves the program's own to the program.
  if (name == "--version") state_->parser->set_version_flag();
  state_->last = state_->parser->add_option(name, *value, help);
  if constexpr (std::is_same_v<Held, double>) state_->last->check(RefuseOtherThanFinite);
  if constexpr (std::is_integral_v<Held>) state_->last->check(RefuseOtherThanInteger<Held>);
  if (std::is_same_v<Held, Value> && !IsPositional(name)) state_->last->capture_default_str();
  return *this;
}

template Command& Command::Option(const std::string&, std::string*, const std::string&);
template Command& Command::Option(const std::string&, double*, const std::string&);
template Command& Command::Option(const std::string&, int*, const std::string&);
template Command& Command::Option(const std::string&, std::int64_t*, const std::string&);
template Command& Command::Option(const std::string&, std::uint64_t*, const std::string&);
template Command& Command::Option(const std::string&,
                                  std::optional<std::string>*,
                                  const std::string&);
template Command& Command::Option(const std::string&, std::optional<double>*, const std::string&);
template Command& Command::Option(const std::string&,
                                  std::optional<std::int64_t>*,
                                  const std::string&);

Command& Command::Option(const std::string& name,
                         std::vector<std::string>* values,
                         const std::string& help) {
  state_->last = state_->parser->add_option(name, *values, help);
  if (IsPositional(name)) return *this;
  // One value per occurrence: an option must not swallow the positional arguments behind it.
  state_->last->expected(1)->allow_extra_args(false)->take_all();
  state_->lists.push_back(state_->last);
  return *this;
}

Command& Command::Time(const std::string& name,
                       std::optional<double>* value_s,
                       const std::string& help) {
  const auto set = [value_s](const std::string& text) {
    const StatusOr<Stamp> time = ParseTime(text, SystemNow());
    if (time.ok()) *value_s = ToSecondsSinceEpoch(*time);
  };
  CLI::Option* const option = state_->parser->add_option_function<std::string>(name, set, help);
  option->type_name("TIME")->check(RefuseOtherThanTime);
  state_->last = option;
  state_->refresh.push_back([option, set] {
    if (option->count() > 0) set(option->results().back());
  });
  state_->parser->footer(fmt::format("TIME (UTC): {}", kTimeForms));
  return *this;
}

Command& Command::Flag(const std::string& name, bool* value, const std::string& help) {
  state_->last = state_->parser->add_flag(name, *value, help);
  return *this;
}

Command& Command::Required() {
  SHIFTMAP_CHECK(state_->last != nullptr, "no option was added before");
  state_->last->required();
  return *this;
}

Command& Command::OneOf(const std::vector<std::string>& allowed) {
  SHIFTMAP_CHECK(state_->last != nullptr, "no option was added before");
  Allow(allowed, state_->last, state_->allowed);
  return *this;
}

Command& Command::InRange(double min, double max) {
  SHIFTMAP_CHECK(state_->last != nullptr, "no option was added before");
  state_->last->check(CLI::Range(min, max).description(fmt::format("[{:g}, {:g}]", min, max)));
  return *this;
}

Command& Command::Excludes(const std::string& other) {
  SHIFTMAP_CHECK(state_->last != nullptr, "no option was added before");
  state_->last->excludes(state_->parser->get_option(other));
  return *this;
}

Command& Command::Output() {
  SHIFTMAP_CHECK(state_->last != nullptr, "no option was added before");
  const CLI::Option* output = state_->last;
  return Check([output, parser = state_->parser]() -> std::string {
    if (output->count() == 0) return "";
    const std::string path = output->results().back();
    if (path == "-") {  // Standard input elsewhere; a file of this name is in nobody's mind.
      return fmt::format("{} '-': expected the name of a file", output->get_name());
    }
    for (const CLI::Option* other : parser->get_options()) {
      if (other == output) continue;
      for (const std::string& value : other->results()) {
        if (IsSameFile(path, value)) {
          return fmt::format(
              "{} '{}' is the file of {}", output->get_name(), path, other->get_name());
        }
      }
    }
    return "";
  });
}

Command& Command::Check(std::function<std::string()> check) {
  state_->checks.push_back(std::move(check));
  return *this;
}

void Command::LetListsTakeSeveral() const {
  for (const CLI::Option* option : state_->parser->get_options()) {
    if (option->get_positional()) return;
  }
  for (CLI::Option* list : state_->lists) {
    list->expected(1, CLI::detail::expected_max_vector_size)->allow_extra_args(true);
  }
}

Command& Command::Watchable(std::function<bool()> looks) {
  state_->parser
      ->add_option(
          "--watch", state_->common->watch_s, "Look again every SECONDS until it is interrupted")
      ->type_name("SECONDS")
      ->check(RefuseOtherThanFinite)
      ->check(CLI::Range(kLeastWatchS, kMostWatchS));
  if (looks == nullptr) return *this;
  return Check([common = state_->common, looks = std::move(looks)] {
    return common->watch_s && !looks() ? "--watch is for an action that only looks" : "";
  });
}

Command& Command::Writes() {
  state_->writes = true;
  state_->parser->add_flag(
      "--dry-run", state_->common->dry_run, "Check and say what would be done; write nothing");
  return *this;
}

}  // namespace shiftmap
