// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "mapper/nightly/area_logs.h"
#include "mapper/nightly/night.h"
#include "mapper/nightly/night_options.h"
#include "mapstore/cli/context.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What the store had of an area when a night was planned.
struct AreaBase {
  std::optional<VersionNumber> published;
  VersionNumber newest = VersionNumber(0);
  std::size_t audit = 0;  ///< Entries.
};

/// A night that several machines share, one area each at a time. Beside its file are a copy of the
/// store, `<plan>.store.db`, and the results, `<plan>.<index>.db` and `.json`: plain files, which
/// may lie on a network file system.
struct NightPlan {
  struct Area {
    std::string area;
    AreaBase base;
    AreaLogs logs;
  };

  std::string store;  ///< Path on the machine that plans and collects.
  bool has_store = false;
  std::string logs;
  int reports_new = 0;
  int reports_known = 0;
  std::vector<std::string> left;
  std::vector<std::string> ignored;
  std::vector<Area> areas;
};

/// Returns the reports and finds the logs, copies the store, and writes the plan.
/// Errors: as FindWork, BackupStore and WriteFileAtomically.
StatusOr<NightPlan> PlanNight(const NightOptions& options,
                              const std::string& path,
                              Context& context);

/// Errors: kNotFound; kInvalidArgument if the file is no plan.
StatusOr<NightPlan> ReadPlan(const std::string& path);

/// Runs an area of a plan on a copy of the store in a folder of this machine, and puts the result
/// beside the plan. Run again it begins anew.
/// @param options  As they were for the plan; `build.store` is set here.
/// @param scratch  Folder on a local disk.
/// Errors: kNotFound if the plan has no such area; as RunArea.
StatusOr<AreaNight> RunPlanned(NightOptions options,
                               const std::string& path,
                               std::int64_t index,
                               const std::string& scratch,
                               Context& context);

/// What became of an area of a plan.
struct CollectedArea {
  std::string area;
  Json document;        ///< As AreaNightJson; null if there is no result.
  std::string problem;  ///< Why the store has not taken the result; empty if it has.
};

/// Takes the results of all areas over into the store, each as if it had been built there: the same
/// versions with the same content hashes, what was held, refused and published. Done again it
/// changes nothing. An area that has changed in the store since the plan is not taken.
StatusOr<std::vector<CollectedArea>> CollectNight(const NightPlan& plan,
                                                  const std::string& path,
                                                  const Context& context);

}  // namespace shiftmap
