// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <ostream>
#include <set>
#include <string>

#include "mapstore/cli/exit_codes.h"
#include "mapstore/cli/progress.h"
#include "mapstore/cli/text_style.h"

namespace shiftmap {

/// A JSON document whose keys stay in the order they were written.
using Json = nlohmann::ordered_json;

/// What the options that every command has were set to.
struct CommonOptions {
  bool json = false;
  bool quiet = false;
  bool dry_run = false;
  std::string log_level = "info";
  std::string config;
  std::optional<double> watch_s;  ///< Of a command that can be repeated. [s]
};

/// What a command's body gets from the application around it.
class Context {
 public:
  /// @param err    Where progress and errors go; must outlive this.
  /// @param style  Of standard output.
  Context(const CommonOptions& options, std::ostream* err, const TextStyle& style = {});

  bool json() const { return options_.json; }
  bool quiet() const { return options_.quiet; }

  /// As --log-level has it.
  const std::string& log_level() const { return options_.log_level; }

  /// Check and say what would be done, but write nothing.
  bool dry_run() const { return options_.dry_run; }

  /// What the text of Report() is set for.
  const TextStyle& style() const { return style_; }

  /// The result of the command, once per run: the document goes to standard output with --json,
  /// the text without, which may be Marked(): RenderMarks() of it, Wrapped() as wide as style().
  void Report(const Json& document, const std::string& text);

  /// One line on standard error, `<program>: warning: <message>`, unless --quiet or --log-level
  /// says otherwise.
  void Warn(const std::string& message) const;

  /// From here on the same warning or information is given once, as of a command that does a work
  /// again and again.
  void SayEachOnce();

  /// As Warn(), but with --quiet as an error, for what a person should see though the command is
  /// done: its exit code is then `code`.
  void Attend(const std::string& message, ExitCode code = ExitCode::kAttention);

  /// What the command does is done. Without a word of it, a script would do it again.
  void NoteEffect() { has_effect_ = true; }

  /// One line on standard error, `<program>: info: <message>`, for a log of what happens over
  /// hours.
  void Inform(const std::string& message) const;

  /// A progress line on standard error, silent with --quiet or if that is no terminal.
  std::unique_ptr<Progress> MakeProgress() const;

  /// True once Report() was called, and what it left for standard output.
  bool reported() const { return reported_; }
  const std::string& output() const { return output_; }

  /// The first line of the text of the report.
  const std::string& summary() const { return summary_; }

  bool has_effect() const { return has_effect_; }

  /// Of a command that is done: kDone, or the code of Attend().
  ExitCode done_code() const { return done_code_; }

 private:
  bool IsNew(const std::string& message) const;

  CommonOptions options_;
  std::ostream* err_;
  TextStyle style_;
  bool reported_ = false;
  bool has_effect_ = false;
  std::string output_;
  std::string summary_;
  ExitCode done_code_ = ExitCode::kDone;
  mutable std::optional<std::set<std::string>> said_;  // If each is to be said once.
};

/// The document as text: indented, UTF-8, numbers that survive a round trip, a newline at the end.
std::string JsonText(const Json& document);

}  // namespace shiftmap
