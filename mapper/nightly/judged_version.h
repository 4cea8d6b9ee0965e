// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mapper/cli/area_build.h"
#include "mapper/nightly/fleet_folder.h"
#include "mapstore/core/ids.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A version to judge; it need not be in the store.
struct JudgedVersion {
  std::optional<VersionNumber> number;  ///< Nothing: it is not in the store.
  std::optional<VersionNumber> parent;
  MapSnapshot map;
  Provenance provenance;
  std::vector<EvidenceRow> rows;  ///< As MapStore::Evidence gives them of the version.

  bool Has(const LogHead& log) const;
};

/// One that is in the store, with its provenance. Errors: those of the store.
StatusOr<JudgedVersion> LoadJudged(const std::string& area,
                                   const VersionSummary& version,
                                   Provenance provenance,
                                   MapStore* store);

/// One that CommitArea would add. Errors: those of the store.
StatusOr<JudgedVersion> JudgedBuild(const std::string& area,
                                    const AreaBuild& build,
                                    MapStore* store);

/// What a build said of itself in its provenance; empty if it said nothing.
struct BuildOutcome {
  std::string night;
  std::optional<double> cost;  ///< As Judgement::cost_after.
  std::vector<std::string> left_out;
  std::vector<std::string> waiting;
  std::vector<std::string> at_two_places;  ///< AreaBuild::at_two_places.
};
BuildOutcome ReadOutcome(const std::string& configuration);

}  // namespace shiftmap
