// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "localizer/live/action_log.h"
#include "localizer/live/messages.h"
#include "localizer/maps/map_folder.h"
#include "proto/core/status.h"

namespace shiftmap::live {

/// Types of errors in the standard's words, and one that it lacks: an action that it knows failed.
inline constexpr const char* kDuplicateMap = "DUPLICATE_MAP";
inline constexpr const char* kUnknownMapId = "UNKNOWN_MAP_ID";
inline constexpr const char* kInvalidInstantAction = "INVALID_INSTANT_ACTION";
inline constexpr const char* kInstantActionFailed = "INSTANT_ACTION_FAILED";

/// What a fleet's control tells a vehicle about maps, and what became of it: VDA 5050 3.0, 6.2 and
/// 6.3. Actions that touch no shift are done here; Service does the others and says how they ended.
///
/// A download is the work of a client, the downloader: one at a time, in the order told. Without a
/// downloader it fails.
class FleetActions {
 public:
  /// @param log     Read.
  /// @param folder  Nothing: the service has one map, which nobody changes here.
  FleetActions(ActionLog log, std::optional<MapFolder> folder)
      : log_(std::move(log)), folder_(std::move(folder)) {}

  /// Takes an action up. Returns its name, or nothing if it was taken up before: it comes again,
  /// and what became of it stands.
  /// @param type  As in the standard, e.g. "enableMap".
  /// Errors: as ActionLog::Add.
  StatusOr<std::optional<std::string>> Begin(const std::string& action_id, const char* type);

  /// An action goes on, or waits.
  void Note(const std::string& action_id, ActionStatus status, std::string result = "");

  /// Ends an action; an error becomes one of the fleet's. Returns `status`.
  /// @param error_type  E.g. kUnknownMapId.
  Status End(const std::string& action_id,
             const Status& status,
             const char* error_type = kInstantActionFailed);

  /// Queues a download; events for the downloader are appended to `events`.
  Status Do(const DownloadMap& action, std::vector<Event>* events);
  Status Do(const DeleteMap& action);
  Status Do(const MapDownloadProgress& progress, std::vector<Event>* events);
  void Clear() { log_.Clear(); }

  /// A downloader came, or went: downloads under way fail then.
  void SetDownloader(bool present);

  /// The folder of maps. Errors: kFailedPrecondition if there is none.
  StatusOr<MapFolder*> Folder();

  /// Fills in the maps of the folder, errors and actions.
  void Fill(FleetState* state) const;

  ActionLog& log() { return log_; }
  bool has_folder() const { return folder_.has_value(); }

 private:
  void HandOver(std::vector<Event>* events);

  ActionLog log_;
  std::optional<MapFolder> folder_;
  std::vector<FleetError> errors_;
  std::deque<DownloadMap> downloads_;  // The first is the downloader's.
  bool downloader_ = false;
};

}  // namespace shiftmap::live
