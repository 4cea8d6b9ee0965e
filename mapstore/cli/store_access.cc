// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/store_access.h"

#include <charconv>
#include <chrono>
#include <cstdlib>
#include <cstring>

namespace shiftmap {
namespace {

constexpr double kLongestWaitS = 86'400.0;

// The environment's value, or nothing if there is none; what is no sensible time is an error.
StatusOr<std::chrono::milliseconds> LockTimeout(std::chrono::milliseconds fallback) {
  const char* text = std::getenv("SHIFTMAP_LOCK_TIMEOUT_S");
  if (text == nullptr) return fallback;
  double seconds = 0.0;
  const auto [end, error] = std::from_chars(text, text + std::strlen(text), seconds);
  if (error != std::errc() || *end != '\0' || !(seconds >= 0.0) || seconds > kLongestWaitS) {
    return InvalidArgument(
        "SHIFTMAP_LOCK_TIMEOUT_S is '{}', expected seconds from 0 to {:.0f}", text, kLongestWaitS);
  }
  return std::chrono::milliseconds(static_cast<std::int64_t>(seconds * 1e3));
}

}  // namespace

StatusOr<MapStore> OpenStore(const std::string& path,
                             MapStore::Access access,
                             const Context& context,
                             double clock_tolerance_s) {
  MapStore::OpenOptions options;
  options.access = access;
  options.clock_tolerance_s = clock_tolerance_s;
  SHIFTMAP_ASSIGN_OR_RETURN(options.lock_timeout, LockTimeout(options.lock_timeout));
  options.on_wait = [&context, path] {
    context.Warn(fmt::format("map store '{}': another process holds it, waiting", path));
  };
  return MapStore::Open(path, options);
}

}  // namespace shiftmap
