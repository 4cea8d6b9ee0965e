// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/json_log.h"

#include <fmt/chrono.h>

#include <chrono>
#include <nlohmann/json.hpp>

#include "mapstore/core/clock.h"
#include "mapstore/core/inert_text.h"

namespace shiftmap::server {
namespace {

const char* NameOf(JsonLog::Level level) {
  switch (level) {
    case JsonLog::Level::kDebug:
      return "debug";
    case JsonLog::Level::kInfo:
      return "info";
    case JsonLog::Level::kWarning:
      return "warning";
    case JsonLog::Level::kError:
    case JsonLog::Level::kOff:
      return "error";
  }
  return "";
}

std::string TimeText(Stamp now) {
  const auto seconds = std::chrono::floor<std::chrono::seconds>(now);
  const auto rest = std::chrono::duration_cast<std::chrono::milliseconds>(now - seconds);
  return fmt::format(
      "{:%FT%T}.{:03}Z",
      fmt::gmtime(std::chrono::system_clock::to_time_t(
          std::chrono::time_point_cast<std::chrono::system_clock::duration>(seconds))),
      rest.count());
}

}  // namespace

JsonLog::Level JsonLog::LevelOf(std::string_view word) {
  if (word == "trace" || word == "debug") return Level::kDebug;
  if (word == "warning") return Level::kWarning;
  if (word == "error") return Level::kError;
  return word == "off" ? Level::kOff : Level::kInfo;
}

void JsonLog::Write(Level level, std::string_view event, const Json& fields) {
  if (!Writes(level)) return;
  Json line = {{"time", TimeText(SystemNow())}, {"level", NameOf(level)}, {"event", event}};
  if (fields.is_object()) line.update(fields);
  const std::string text =
      InertText(line.dump(-1, ' ', false, Json::error_handler_t::replace)) + '\n';
  const std::lock_guard lock(mutex_);
  out_->clear();  // The disk of the log may have been full.
  *out_ << text << std::flush;
}

}  // namespace shiftmap::server
