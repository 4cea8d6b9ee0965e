// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mapper/cli/area_build.h"
#include "mapper/nightly/fleet_folder.h"
#include "mapper/nightly/judged_version.h"
#include "mapper/nightly/night_options.h"
#include "mapstore/cli/context.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A map that is to be judged: a version that an earlier start of the night left in the store, or a
/// build that is not there.
struct Candidate {
  JudgedVersion version;
  BuildOutcome outcome;
  std::optional<AreaBuild> build;  ///< Nothing: the version is in the store.
};

/// Identifies the build of a set of logs by this program with these options:
/// AreaBuildOptions::night. Memory is not among them: it changes from night to night.
std::string NightKey(const std::vector<LogHead>& logs, const AreaBuildOptions& build);

/// Makes the maps that a night judges for an area, and writes none.
/// Errors, of every function: kCancelled if a signal came; those of the store.
/// Precondition: a StopSignals lives.
class CandidateBuilder {
 public:
  /// @param options  Outlive this, as does the context.
  CandidateBuilder(const NightOptions& options, std::string area, Context* context)
      : options_(options), area_(std::move(area)), context_(*context) {}

  /// The version of these logs that the store has since the last one was published, or else a
  /// build.
  /// @param reasons  Gets why there is no map, where nothing is returned.
  /// @param waiting  Gets the runs that wait then.
  /// @param for_good  Whether the same logs will give no map another time either.
  StatusOr<std::optional<Candidate>> Make(const std::vector<LogHead>& logs,
                                          std::vector<std::string>* reasons,
                                          std::vector<UnplacedRun>* waiting,
                                          bool* for_good) const;

  /// A FoldBuilder.
  StatusOr<std::optional<JudgedVersion>> BuildFold(const std::vector<LogHead>& logs) const;

 private:
  AreaBuildOptions BuildOptions(const std::vector<LogHead>& logs) const;
  StatusOr<std::optional<Candidate>> Find(const std::string& night) const;
  StatusOr<JudgedVersion> JudgedOf(const AreaBuild& build) const;

  const NightOptions& options_;
  const std::string area_;
  Context& context_;
};

}  // namespace shiftmap
