// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <ostream>
#include <string>
#include <string_view>

namespace shiftmap::server {

using Json = nlohmann::ordered_json;

/// The log of a service: one JSON object a line, `{"time", "level", "event", …}`, UTF-8, without
/// control characters. Threads: any.
class JsonLog {
 public:
  enum class Level { kDebug, kInfo, kWarning, kError, kOff };

  /// The level of a `--log-level`; kInfo for a word that is none.
  static Level LevelOf(std::string_view word);

  /// @param out  Must outlive this.
  JsonLog(std::ostream* out, Level least) : out_(out), least_(least) {}

  /// @param event   A word, e.g. "report".
  /// @param fields  An object; its members follow.
  void Write(Level level, std::string_view event, const Json& fields);

  bool Writes(Level level) const { return level >= least_; }

 private:
  std::ostream* const out_;
  const Level least_;
  std::mutex mutex_;
};

}  // namespace shiftmap::server
