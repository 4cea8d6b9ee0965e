// SPDX-License-Identifier: Apache-2.0
//
// Actions on maps and pose, and what a vehicle's state message takes from the localizer, in the
// terms of VDA 5050 3.0 (proto/live.proto says what each field means).
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/geometry/covariance.h"
#include "proto/core/status.h"

namespace shiftmap::live {

/// A map as MapVersionName() names it, and the action that is about it.
struct MapAction {
  std::string action_id;  ///< Empty: the service draws one.
  std::string map_id;
  std::string map_version;
};

/// Also the event that tells a client of a download.
struct DownloadMap : MapAction {
  std::string link;
  std::string sha256;  ///< Of the file, in hex; empty: not known.
};

struct EnableMap : MapAction {};

struct DeleteMap : MapAction {};

/// The pose at the next scan, on the enabled map of an area.
struct InitializePosition {
  std::string action_id;
  std::string map_id;
  PoseWithCovariance pose;
  bool check = false;  ///< Finished once landmarks agree with the pose, and not at once.
};

/// Forgets the actions that ended.
struct ClearActions {};

struct GetFleetState {};

/// What became of a download so far.
struct MapDownloadProgress {
  std::string action_id;
  bool ended = false;  ///< Else it has begun.
  Status status;       ///< With which it ended.
};

enum class ActionStatus { kWaiting, kInitializing, kRunning, kFinished, kFailed };

/// As in the standard, e.g. "RUNNING".
inline const char* ToString(ActionStatus status) {
  switch (status) {
    case ActionStatus::kWaiting:
      return "WAITING";
    case ActionStatus::kInitializing:
      return "INITIALIZING";
    case ActionStatus::kRunning:
      return "RUNNING";
    case ActionStatus::kFinished:
      return "FINISHED";
    case ActionStatus::kFailed:
      return "FAILED";
  }
  return "";
}

struct ActionState {
  std::string action_id;
  std::string type;  ///< As in the standard, e.g. "downloadMap".
  ActionStatus status = ActionStatus::kWaiting;
  std::string result;  ///< One line.

  bool ended() const {
    return status == ActionStatus::kFinished || status == ActionStatus::kFailed;
  }
};

struct FleetError {
  std::string type;
  std::string level;
  std::string description;
  std::vector<std::pair<std::string, std::string>> references;  ///< Key and value.
};

struct FleetState {
  struct Map {
    std::string map_id;
    std::string map_version;
    bool enabled = false;
  };
  std::vector<Map> maps;
  std::string map_id;                ///< Of the pose.
  std::optional<Se2> T_map_vehicle;  ///< The last one; nothing if there never was one.
  bool localized = false;            ///< It can be trusted.
  double localization_score = 0.0;
  std::optional<double> deviation_range_m;  ///< Holds the position with probability 0.95. [m]
  std::vector<FleetError> errors;
  std::vector<ActionState> actions;
};

}  // namespace shiftmap::live
