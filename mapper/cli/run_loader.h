// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mapper/cli/log_file.h"
#include "mapper/mapper.h"
#include "mapstore/cli/context.h"
#include "mapstore/core/clock.h"
#include "mapstore/run/item_limits.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

struct RunLoaderOptions {
  std::string area;                 ///< For messages.
  std::vector<std::string> logs;    ///< Paths.
  std::vector<LineRun> known_runs;  ///< Those that are in the map already.

  /// Reads what the ledger has of the visits of these runs. It is called for a log only where hash
  /// and UUID do not identify its run (FindMappedRun).
  std::function<StatusOr<std::vector<EvidenceRow>>()> known_visits;

  /// As MissingRest. It is called for a log that another one of its run is in the map of.
  std::function<StatusOr<std::optional<std::string>>(const LineRun& mapped, const Run& log)>
      missing_rest;

  /// Bound on the build's memory, and what it grows with beside the logs. [bytes]
  std::int64_t max_memory_bytes = 0;
  std::int64_t prior_modes = 0;
  int threads = 1;

  bool lidar_scans = false;  ///< As RunLogReaderOptions::lidar_scans.
  ItemLimits limits;
  Stamp now = SystemNow();
  double clock_tolerance_s = kDefaultClockToleranceS;  ///< As CheckNotInFuture. [s]
  bool unique_names = false;                           ///< Two logs of one name are an error.
  std::function<Status()> on_step;                     ///< Asked before each log; an error ends it.
};

struct LoadedRuns {
  std::vector<MapperInput> inputs;
  std::vector<RejectedRun> rejected;                ///< By name.
  std::map<std::string, ImplausibleItems> dropped;  ///< By the log's SHA-256; only where any.
  std::vector<ReadLog> files;                       ///< All, as they were before they were read.
};

/// Reads the logs of a build. A log that is damaged, ends in the future, names another area, is a
/// log of another one's run that tells less of it, is of a run that is in the map (FindMappedRun),
/// or takes too much memory is left out by name, so that the others need not wait for it. Of logs
/// that are too much together the largest are left out, whatever their order. Warns of logs that
/// are cut off, hold implausible items, or were recorded without a clock.
///
/// Memory: never more than `max_memory_bytes`, and one chunk of a log.
/// Errors: those of the first log by name that is left out if none is left, kAlreadyExists if all
/// are in the map; kNotFound and kUnavailable for a log that cannot be opened; that of `on_step`.
StatusOr<LoadedRuns> LoadRuns(const RunLoaderOptions& options, const Context& context);

}  // namespace shiftmap
