// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mapper/nightly/area_logs.h"
#include "mapper/nightly/judge.h"
#include "mapper/nightly/night_options.h"
#include "mapstore/cli/context.h"
#include "mapstore/core/ids.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Refusals in a row from which on somebody has to look at an area.
inline constexpr int kAlarmRefusals = 3;

/// What a night did to an area.
struct AreaNight {
  std::string area;
  std::size_t runs_new = 0;      ///< Of the version, that the published one has not; or new logs.
  std::size_t runs_again = 0;    ///< Of the version, that the published one has; or such logs.
  std::size_t held_out = 0;      ///< New logs kept from the build to judge it.
  std::size_t runs_waiting = 0;  ///< Of the build: their place in the map is ambiguous.
  std::optional<VersionNumber> version;  ///< That was made, or goes on waiting to be published.
  std::string content_hash;
  bool published = false;
  std::vector<std::string> reasons;  ///< What a person should see, a line each.
  std::optional<Judgement> judgement;
  int refused_in_a_row = 0;  ///< Versions not published since the last one that was.
  bool alarm() const { return refused_in_a_row >= kAlarmRefusals; }
};

/// Builds the new logs of an area on its published version, judges the version and publishes it if
/// it is not worse. A run of the build that fits neither map is held, and the area built without
/// it. Where the version is worse and no run is suspect, the area is built once more without the
/// vehicle that fits the old map worst; if that is not worse, its runs are held. Else the version
/// stays, with the reasons in the audit log. Nothing but the version that stands is written, once
/// it is judged.
///
/// Whatever was written stays good if the process ends in between: runs that are held stay so, and
/// a version that was refused is neither built nor judged again. Errors: kCancelled if a signal
/// came; those of the store. A build that fails is a reason. Precondition: a StopSignals lives.
StatusOr<AreaNight> RunAreaNight(const NightOptions& options,
                                 const std::string& area,
                                 const AreaLogs& logs,
                                 Context& context);

}  // namespace shiftmap
