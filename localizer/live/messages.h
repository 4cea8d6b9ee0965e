// SPDX-License-Identifier: Apache-2.0
//
// What a vehicle and its localizer say to each other, as values (proto/live.proto says what each
// field means).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "localizer/hypothesis/hypothesis_view.h"
#include "localizer/live/fleet_messages.h"
#include "localizer/localizer_options.h"
#include "localizer/localizer_state.h"
#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/evidence.h"
#include "mapstore/run/run.h"
#include "proto/core/status.h"

namespace shiftmap::live {

struct GetState {
  bool hypotheses = false;  ///< Also what the vehicle believes, and why.
};

/// Begins a shift.
struct Start {
  std::string vehicle;               ///< Empty: as the service was configured.
  std::optional<double> odometer_m;  ///< What the vehicle's odometer shows. [m]
};

/// Ends the shift and writes its report.
struct Stop {
  bool save_pose = false;  ///< For the next start.
};

/// Takes another map, between shifts.
struct SetMap {
  std::string area;
  std::optional<VersionNumber> version;  ///< Nothing: the published one.
  std::string content_hash;              ///< If not empty, what the map's must be.
};

/// The pose at the next scan, known from elsewhere.
struct InitializePose {
  PoseWithCovariance pose;
};

/// What a client wants to be told, from now on.
struct Subscribe {
  bool poses = false;
  bool states = false;
  bool decisions = false;
  bool map_downloads = false;  ///< To download maps for the service.
  bool map_owner = false;      ///< The client decides on maps.
};

using Command = std::variant<OdometrySample,
                             Scan,
                             LidarScan,
                             GetState,
                             Start,
                             Stop,
                             SetMap,
                             InitializePose,
                             Subscribe,
                             DownloadMap,
                             EnableMap,
                             DeleteMap,
                             InitializePosition,
                             ClearActions,
                             GetFleetState,
                             MapDownloadProgress>;

/// True for an item of the run.
inline bool Feeds(const Command& command) {
  return std::holds_alternative<OdometrySample>(command) || std::holds_alternative<Scan>(command) ||
         std::holds_alternative<LidarScan>(command);
}

/// True for what is answered with the fleet's state.
inline bool AsksForFleetState(const Command& command) {
  return std::holds_alternative<DownloadMap>(command) ||
         std::holds_alternative<EnableMap>(command) || std::holds_alternative<DeleteMap>(command) ||
         std::holds_alternative<InitializePosition>(command) ||
         std::holds_alternative<ClearActions>(command) ||
         std::holds_alternative<GetFleetState>(command);
}

struct Request {
  std::uint64_t id = 0;  ///< 0: no reply wanted.
  Command command;
  bool from_map_owner = false;  ///< Of a client that subscribed as such; not on the wire.
};

/// How the stamps of the items lie to the time line of the shift and to this host's clock.
enum class TimeLine {
  kAgrees,
  kLate,    ///< All are older than what was localized: the vehicle's clock was set back.
  kFuture,  ///< They are ahead of this host's clock: one of the clocks is wrong.
};

/// As in JSON, e.g. "LATE".
inline const char* ToString(TimeLine time_line) {
  switch (time_line) {
    case TimeLine::kAgrees:
      return "AGREES";
    case TimeLine::kLate:
      return "LATE";
    case TimeLine::kFuture:
      return "FUTURE";
  }
  return "";
}

/// What the service is doing.
struct ServiceState {
  bool running = false;  ///< A shift is under way.
  std::string area;
  VersionNumber version;
  std::string content_hash;
  std::string report_uuid;  ///< Of the shift, or of the last one.
  std::string report_path;  ///< Of the last report written.
  bool resumed = false;     ///< The shift was interrupted.
  LocalizerState localizer_state = LocalizerState::kInitializing;
  Stamp stamp;                             ///< Of the last item.
  std::optional<PoseWithCovariance> pose;  ///< Then.
  std::int64_t scans = 0;
  std::int64_t decisions = 0;
  std::string calibrated_vehicle;  ///< Whose calibration the shift uses; empty: the fleet's.
  std::int64_t overruns = 0;       ///< Steps that took longer than their budget.
  std::vector<DroppedCount> dropped;

  /// If it does not agree, no item is taken in: the state is LOST, and there is no pose.
  TimeLine time_line = TimeLine::kAgrees;
  std::int64_t clock_jumps = 0;  ///< Shifts that ended because the vehicle's clock was set back.
};

struct Reply {
  std::uint64_t id = 0;
  Status status;
  std::optional<ServiceState> state;  ///< After the request; none for items of the run.
  std::optional<HypothesisView> hypotheses = std::nullopt;  ///< If asked for and there is a pose.
  std::optional<FleetState> fleet_state = std::nullopt;     ///< After an action, and if asked for.
};

/// The pose after an item of the run.
struct PoseEvent {
  Stamp stamp;
  PoseWithCovariance pose;
  LocalizerState state = LocalizerState::kInitializing;
};

/// The state is another one from `stamp` on.
struct StateEvent {
  Stamp stamp;
  LocalizerState state = LocalizerState::kInitializing;
};

using Event = std::variant<Reply, PoseEvent, StateEvent, Decision, DownloadMap>;

/// What a shift was begun with; the first record of its journal.
struct ShiftHeader {
  std::string uuid;  ///< Of the report: drawn once, so that a resumed shift reports once.
  std::string vehicle;
  std::string area;
  VersionNumber version;
  std::string content_hash;
  Stamp map_stamp;  ///< At which the map's probabilities held.
  double alpha = 0.0;
  int max_leaves = 0;
  double max_delay_s = 0.0;          ///< As LocalizerOptions::max_delay_s.
  std::optional<double> odometer_m;  ///< What the vehicle's odometer showed. [m]
  LimitOptions limits;               ///< As LocalizerOptions::limits.
  FieldOfViewModel field_of_view = FieldOfViewModel::kSector;
  std::string map_sha256;  ///< Of the snapshot file, if it is one of a folder of maps.
};

/// Everything that a shift's result depends on, in order: the header, then the inputs as they came.
using JournalRecord = std::variant<ShiftHeader, OdometrySample, Scan, LidarScan, InitializePose>;

/// Where the vehicle stood at the end of a shift.
struct SavedPose {
  std::string area;
  std::string content_hash;
  Stamp stamp;
  PoseWithCovariance pose;
  std::optional<double> odometer_m;  ///< What the vehicle's odometer showed then. [m]
};

}  // namespace shiftmap::live
