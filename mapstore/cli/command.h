// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/cli/context.h"
#include "proto/core/status.h"

namespace shiftmap {

/// One command of a program: its options and its body.
///
/// A name with dashes (`--store`) is an option, a name without (`RUN`) a positional argument. The
/// variable behind an option holds its default, is set when the option is given, and must outlive
/// the run. Names of options are unique within a command.
class Command {
 public:
  using Body = std::function<Status(Context&)>;

  ~Command();
  Command(const Command&) = delete;
  Command& operator=(const Command&) = delete;

  /// @tparam Value  std::string, double, int, std::int64_t or std::uint64_t, whose default help
  ///                shows, or an std::optional of a string, double or std::int64_t.
  template <typename Value>
  Command& Option(const std::string& name, Value* value, const std::string& help);

  /// An option given several times, or a positional argument that takes all that are left. In a
  /// command without positional arguments one occurrence takes several values.
  Command& Option(const std::string& name,
                  std::vector<std::string>* values,
                  const std::string& help);

  /// A time as ParseTime() reads it: `2026-01-09`, `-8h`, `now`, seconds since the epoch. A usage
  /// error lists the forms. A relative one is taken from the start of each repetition.
  /// @param value_s  Seconds since the epoch.
  Command& Time(const std::string& name, std::optional<double>* value_s, const std::string& help);

  /// Set by being there.
  Command& Flag(const std::string& name, bool* value, const std::string& help);

  // These say more of the option added last.
  Command& Required();
  Command& OneOf(const std::vector<std::string>& allowed);
  Command& InRange(double min, double max);

  /// Not together with `other`, an option added before. Given on the command line, it also takes
  /// the place of the other one in the site file or the environment.
  Command& Excludes(const std::string& other);

  /// The command writes a file with this name, which is not `-`. No other option may name the same
  /// file.
  Command& Output();

  /// A check of the options as a whole, once they are read: the message of a usage error, or
  /// nothing.
  Command& Check(std::function<std::string()> check);

  /// The command writes something that outlives it: it has --dry-run.
  Command& Writes();

  /// The command only looks: it has --watch SECONDS, and its body may run several times.
  /// @param looks  Of a command of which some actions write: whether this one only looks.
  Command& Watchable(std::function<bool()> looks = nullptr);

 private:
  friend class Application;
  struct State;
  explicit Command(std::unique_ptr<State> state);

  /// To be called once all options are added.
  void LetListsTakeSeveral() const;

  std::unique_ptr<State> state_;
};

}  // namespace shiftmap
