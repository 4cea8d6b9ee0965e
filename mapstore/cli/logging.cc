// SPDX-License-Identifier: Apache-2.0
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include "mapstore/cli/internal/logging.h"

namespace shiftmap {

ScopedLogging::ScopedLogging(const std::string& program,
                             const CommonOptions& options,
                             std::ostream* err)
    : previous_(spdlog::default_logger()) {
  auto sink = std::make_shared<spdlog::sinks::ostream_sink_mt>(*err, /*force_flush=*/true);
  auto logger = std::make_shared<spdlog::logger>(program, std::move(sink));
  logger->set_pattern("%n: %l: %v");
  const auto level = spdlog::level::from_str(options.log_level);
  logger->set_level(options.quiet ? std::max(level, spdlog::level::err) : level);
  spdlog::set_default_logger(std::move(logger));
}

ScopedLogging::~ScopedLogging() { spdlog::set_default_logger(previous_); }

}  // namespace shiftmap
