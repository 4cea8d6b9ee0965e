// SPDX-License-Identifier: Apache-2.0
//
// What a map store knows of a single landmark, for people who ask why the map says what it says.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/landmark_group.h"
#include "mapstore/store_types.h"

namespace shiftmap {

/// When a visit was.
struct VisitSpan {
  Stamp begin;
  Stamp end;
};

/// Of which map version, and as of when, MapStore::LoadLandmark tells.
struct LandmarkQuery {
  /// Nothing: the published one, at `known` if given.
  std::optional<VersionNumber> version = std::nullopt;

  std::optional<Stamp> at = std::nullopt;     ///< As for LoadAt. Later visits are left out.
  std::optional<Stamp> known = std::nullopt;  ///< As for LoadKnown; nothing: now.

  /// Times for LandmarkRecords::track, in any order.
  std::vector<Stamp> track = {};

  /// More such times, chosen from the visits up to `at` and the version's stamp; may be empty.
  std::function<std::vector<Stamp>(const std::vector<VisitSpan>& visits, Stamp version)>
      choose_track = {};
};

/// A row of the ledger about the landmark.
struct LandmarkVisit {
  VisitEvidence evidence;
  std::string vehicle;
  std::string run;        ///< RunRecord::identity, or UUID of the report of a shift without a log.
  std::string run_name;   ///< The log file's stem; empty if no build has read the log.
  std::string report;     ///< UUID of the shift report; empty if a build mapped the run.
  VersionNumber version;  ///< The one driven on, or the one that mapped the run.
  Stamp arrived;          ///< When the store got the row, by the clock of the machine that wrote.

  /// The last decision of the localizer inside the visit, if a report has one.
  std::optional<Decision> decision;

  std::optional<SetAside> set_aside;  ///< Why it does not count for the version.

  /// Of LandmarkRecords::group after the visit, at its end; size states. Empty if it does not
  /// count.
  Eigen::VectorXd probabilities;

  bool mapped() const { return report.empty(); }
};

/// Probabilities of the landmark that a version states, as an import does.
struct LandmarkStatement {
  VersionNumber version;
  Stamp stamp;                    ///< They hold then.
  Eigen::VectorXd probabilities;  ///< Carried to the states of LandmarkRecords::group.
};

/// The landmark in one map version.
struct LandmarkInVersion {
  VersionNumber version;
  std::optional<VersionNumber> parent;
  Stamp stamp;  ///< MapContent::stamp: end of the newest run in it.
  Stamp created;
  bool in_line = false;     ///< It is the version that was asked for, or an ancestor of it.
  bool known = false;       ///< It has the landmark.
  std::vector<Mode> modes;  ///< By ascending number.
  std::vector<MergedMode> merged;
  double leave_rate_per_s = 0.0;  ///< ModeChain::leave_rate_per_s.
};

/// One landmark: all that the ledger and the versions of the area tell of it.
struct LandmarkRecords {
  Signature signature;    ///< In that version: a former name was asked for, or it is the same.
  VersionNumber version;  ///< The one that was asked for.
  Stamp stamp;            ///< The probabilities of `group` hold then.

  /// In that version, with the probabilities of LoadAt or LoadKnown; nothing if it has none.
  std::optional<LandmarkGroup> group;

  std::vector<LandmarkVisit> visits;           ///< By begin, then end, vehicle and run.
  std::optional<LandmarkStatement> statement;  ///< The one that holds for the version.
  std::vector<LandmarkInVersion> versions;     ///< Those whose content is stored, oldest first.

  std::vector<Stamp> track_times;  ///< LandmarkQuery::track, then what choose_track added.

  /// By `track_times`: the probabilities then, filtered from the visits that count and begin
  /// up to then; other than for LoadAt also before the version was made. Empty where the file is a
  /// snapshot that begins later, or there is no `group`.
  std::vector<Eigen::VectorXd> track;
};

/// Of which map version MapStore::LoadTracks tells, and how much.
struct TracksQuery {
  /// Nothing: the published one, at `known` if given.
  std::optional<VersionNumber> version = std::nullopt;

  std::int64_t max_visits = 1'000'000;  ///< The newest rows of the ledger that are read; >= 1.
  std::optional<Stamp> known = std::nullopt;  ///< As for LoadKnown; nothing: now.
};

/// The probabilities of a landmark from a time on.
struct TrackPoint {
  Stamp begin;                    ///< They are what LoadAt gives from here on,
  Stamp end;                      ///< and the chain runs them from here on, to the next point.
  Eigen::VectorXd probabilities;  ///< Size states.
};

/// All landmarks of a map version over time.
struct LandmarkTracks {
  VersionNumber version;
  Stamp since = Stamp::min();  ///< What began earlier is left out.

  // By the index of the group in the map.

  /// By begin; the first holds before it, too. Other than for LoadAt, they tell also of times
  /// before the version was made: by the visits that count and begin up to then.
  std::vector<std::vector<TrackPoint>> points;
  std::vector<std::vector<LandmarkVisit>> visits;  ///< As LandmarkRecords::visits.
};

}  // namespace shiftmap
