// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <ostream>
#include <string>

#include "mapstore/cli/context.h"

namespace spdlog {
class logger;
}

namespace shiftmap {

/// Sends the process' log to a stream while it lives, and then back to where it went before.
class ScopedLogging {
 public:
  ScopedLogging(const std::string& program, const CommonOptions& options, std::ostream* err);
  ~ScopedLogging();
  ScopedLogging(const ScopedLogging&) = delete;
  ScopedLogging& operator=(const ScopedLogging&) = delete;

 private:
  std::shared_ptr<spdlog::logger> previous_;
};

}  // namespace shiftmap
