// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "localizer/models/field_of_view.h"
#include "mapper/cli/log_file.h"
#include "mapper/mapper.h"
#include "mapper/tree/tree_options.h"
#include "mapstore/cli/context.h"
#include "mapstore/cli/input_options.h"
#include "mapstore/core/clock.h"
#include "mapstore/map_store.h"
#include "mapstore/run/item_limits.h"

namespace shiftmap {

/// A build of one area: the options of `shiftmap-mapper build`.
struct AreaBuildOptions {
  std::string store;
  std::string area;
  std::string selector = "viterbi";
  std::string engine = "graph";
  std::string solver = "schur";  ///< Of the graph.
  TreeSlamOptions tree;
  std::string field_of_view = FieldOfViewNames().front();  ///< Of the tree.
  std::string tree_insertion = "back-track";
  std::string tree_merging = "heavier";
  std::string prior = "published";
  std::string anonymous = "ignore";
  std::string placement = "posterior";
  bool no_publish = false;
  bool no_calibration = false;
  bool no_learned_rates = false;
  std::optional<std::int64_t> max_memory_mib;
  LimitOptions limits;
  double clock_tolerance_s = kDefaultClockToleranceS;
  std::optional<std::string> trajectories;
  std::uint64_t seed = MapperOptions().seed;
  int threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  double leave_rate_per_s = ModeOptions().leave_rate_per_s;
  std::vector<std::string> logs;

  /// Whether a build starts anew where every stored version of the published one's line rests on
  /// what was taken out, instead of failing: for whoever gives it the logs of all runs.
  bool starts_anew = false;

  /// What tells the build of a night apart, for one that goes on where another one was interrupted;
  /// empty of another build.
  std::string night;
};

/// What became of it.
struct AreaBuild {
  MapperResult result;
  std::map<std::string, ImplausibleItems> dropped;  ///< By the log's SHA-256; only where any.
  std::vector<std::string> fallen_out;              ///< Of versions that are no prior any more.
  std::vector<UnplacedRun> not_given;               ///< That wait, but not of this build.
  std::vector<std::string> at_two_places;           ///< A line for each vehicle that was.

  std::vector<std::string> objections;  ///< FindObjections; of a dry run with a prior none.

  std::vector<ReadLog> files;  ///< As they were when the build read them.

  // What CommitArea adds to the store with the map.
  Provenance provenance;
  CommitOptions commit_options;

  std::optional<CommitResult> commit;  ///< Nothing if every run waits, or before CommitArea.

  /// Reports that counted for the version published before and do not for this one, because they
  /// are of versions that it does not go on from, as after a rollback.
  int reports_set_aside = 0;
};

/// Builds a map of an area from run logs, on the map that the store has of it, in memory. The
/// store gets nothing but the version that holds the edits in force (MapStore::WithEditsInForce).
/// Errors: as LoadRuns and BuildMap; kCancelled if a signal came (StopSignals).
/// Precondition: a StopSignals lives.
StatusOr<AreaBuild> MakeAreaBuild(const AreaBuildOptions& options, Context& context);

/// Adds a build to the store as a version, and sets `commit`; where all of its runs wait, only
/// notes that. Errors: as MapStore::Commit; kAborted if a log was changed since it was read.
Status CommitArea(const AreaBuildOptions& options, const Context& context, AreaBuild* build);

/// Both, the second unless it is a dry run.
/// Errors: as theirs; after kCancelled nothing is written.
/// Precondition: a StopSignals lives.
StatusOr<AreaBuild> BuildArea(const AreaBuildOptions& options, Context& context);

}  // namespace shiftmap
