// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "mapper/nightly/fleet_folder.h"
#include "mapper/nightly/judged_version.h"
#include "mapper/nightly/paired_test.h"
#include "mapper/nightly/refused_versions.h"
#include "mapper/nightly/replay.h"
#include "mapstore/core/ids.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// How much work judging a version may be.
struct JudgeOptions {
  int max_shifts = 12;  ///< That are replayed at most; as many again takes as long again.

  /// Builds at most of which each leaves a part of the runs out, where no other shifts judge the
  /// version; together they take about as long as (folds - 1) builds more. Below 2: none.
  int max_folds = 2;
};

/// A shift on both maps.
struct JudgedShift {
  std::string path;
  std::string run;  ///< As LogHead::identity.
  std::string vehicle;
  bool in_build = false;  ///< The build took it, so that its gain proves nothing.

  /// From 1: the map after is that of a build which left the run out. 0: it is the version's.
  int fold = 0;

  std::optional<ShiftScore> before;  ///< Nothing: there was no map.
  ShiftScore after;

  /// Of a run of the build: on the new map, with the calibration of the old one. Landmarks that
  /// moved do no harm there, odometry that is not as it was does.
  std::optional<ShiftScore> as_calibrated_before;
};

/// What the tests of a judgement rest on.
enum class JudgedBy {
  kNothing,  ///< There is no map before, or no shift.
  kShifts,   ///< Shifts that the build did not take, beside its own.
  kFolds,    ///< The build's shifts, each on a map that was built without it.
  kShiftsAndFolds,
  kOwnShifts,  ///< The build's shifts alone.
};

/// Whether a version is good enough for vehicles.
struct Judgement {
  std::optional<VersionNumber> before;  ///< What it is judged against; nothing: there is none.
  std::optional<VersionNumber> after;   ///< Nothing: it is not in the store.
  JudgedBy judged_by = JudgedBy::kNothing;

  std::optional<double> cost_before;  ///< Squared residuals per observation; if the build says.
  std::optional<double> cost_after;

  int modes_made = 0;
  int modes_removed = 0;
  int modes_merged = 0;
  int landmarks_made = 0;
  int landmarks_removed = 0;
  std::vector<std::string> moved;   ///< Landmarks with a mode moved beyond its covariance.
  std::vector<JudgedShift> shifts;  ///< Of the build first, then by begin.

  struct NamedTest {
    const char* name;  ///< A word, e.g. "nis".
    PairedTestResult result;
  };
  std::vector<NamedTest> tests;

  std::vector<std::string> worse;  ///< Why it is not published; none: it is not worse.

  struct Suspect {
    std::string path;  ///< Of its log.
    std::string reason;
  };
  std::vector<Suspect> suspects;  ///< Runs of the build that should not be in a map.

  std::vector<std::string> doubts;  ///< About clocks, where nothing decides; a line each.
};

/// The logs that a judgement may replay.
struct JudgedLogs {
  std::vector<LogHead> built;     ///< Given to the build.
  std::vector<LogHead> held_out;  ///< New, and kept from it for the judgement.
  std::vector<LogHead> mapped;    ///< In the map already.

  RefusedVersions refused = {};  ///< Shifts that judged these judge no other.
};

/// Builds some logs on the map that the version was made from, and adds nothing to the store.
/// Nothing: the build gives no map.
using FoldBuilder =
    std::function<StatusOr<std::optional<JudgedVersion>>(const std::vector<LogHead>& logs)>;

/// Judges a version against the one that it was made from.
///
/// Shifts are replayed by the localizer on both maps, each from a start that is found, and with the
/// probabilities of KnownBefore: of both maps from the new one's rows, the shift's own left out.
/// Where landmarks have moved since, the old map is bound to be worse, and that blocks nothing: the
/// test is one-sided. Gains count little, so that no run is explained at the expense of the others:
/// those of a run that the build took count nothing, others the margin at most (PairedTest).
/// Where no other shifts are there, the build's are judged in folds: each on a map that is built
/// without its part of them, or on the version itself if that is worse for them. Landmarks count
/// there where they stood at a place of the old map: every build numbers what it finds by itself.
///
/// A run of the build is suspect if it fits neither the old map nor the new one with the old
/// calibration, though the others do: with a calibration of its own a broken odometer fits itself.
/// A run is suspect too if its clock is wrong (CheckClocks).
///
/// The version is worse if a test says so, if its cost has grown by more than the factor, or if
/// modes are gone that nobody retired. A landmark that moved beyond its covariance blocks nothing.
/// @param on_step  Asked now and then; an error ends it.
/// Errors: those of the store and of `on_step`. A log that cannot be replayed is left out.
StatusOr<Judgement> Judge(const std::string& area,
                          const JudgedVersion& version,
                          const JudgedLogs& logs,
                          const JudgeOptions& options,
                          const FoldBuilder& build,
                          MapStore* store,
                          const std::function<Status()>& on_step);

}  // namespace shiftmap
