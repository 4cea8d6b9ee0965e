// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/fleet_actions.h"

#include <algorithm>

#include "mapstore/codec/shift_report.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap::live {
namespace {

constexpr const char* kWarning = "WARNING";

Status CheckNames(const MapAction& action) {
  SHIFTMAP_RETURN_IF_ERROR(CheckReportText("mapId", action.map_id));
  return CheckReportText("mapVersion", action.map_version);
}

}  // namespace

StatusOr<std::optional<std::string>> FleetActions::Begin(const std::string& action_id,
                                                         const char* type) {
  const std::string id = action_id.empty() ? RandomUuid() : action_id;
  if (log_.Find(id) != nullptr) return std::optional<std::string>();
  SHIFTMAP_RETURN_IF_ERROR(CheckReportText("actionId", id));
  SHIFTMAP_RETURN_IF_ERROR(log_.Add({id, type, ActionStatus::kInitializing, ""}));
  return std::optional<std::string>(id);
}

void FleetActions::Note(const std::string& action_id, ActionStatus status, std::string result) {
  log_.Set(action_id, status, std::move(result));
  // Errors stand until another action is accepted.
  errors_.clear();
}

Status FleetActions::End(const std::string& action_id,
                         const Status& status,
                         const char* error_type) {
  if (status.ok()) {
    Note(action_id, ActionStatus::kFinished);
    return status;
  }
  log_.Set(action_id, ActionStatus::kFailed, Message(status));
  std::erase_if(errors_, [&](const FleetError& error) { return error.type == error_type; });
  errors_.push_back({error_type, kWarning, Message(status), {{"actionId", action_id}}});
  return status;
}

StatusOr<MapFolder*> FleetActions::Folder() {
  if (folder_) return &*folder_;
  return FailedPrecondition("no folder of maps, expected a service with --maps");
}

Status FleetActions::Do(const DownloadMap& action, std::vector<Event>* events) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto id, Begin(action.action_id, "downloadMap"));
  if (!id) return OkStatus();
  const auto folder = Folder();
  if (!folder.ok()) return End(*id, folder.status(), kInvalidInstantAction);
  if (const Status status = CheckNames(action); !status.ok()) {
    return End(*id, status, kInvalidInstantAction);
  }
  const auto is_it = [&](const DownloadMap& other) {
    return other.map_id == action.map_id && other.map_version == action.map_version;
  };
  if ((*folder)->Find(action.map_id, action.map_version).ok() ||
      std::any_of(downloads_.begin(), downloads_.end(), is_it)) {
    const Status status = MakeStatus(StatusCode::kAlreadyExists,
                                     "map '{}' version '{}' is there or on its way already",
                                     action.map_id,
                                     action.map_version);
    End(*id, status, kDuplicateMap).IgnoreError();
    errors_.back().references = {{"mapId", action.map_id}, {"mapVersion", action.map_version}};
    return status;
  }
  if (!downloader_) {
    return End(*id,
               Unavailable("no downloader is connected, expected 'shiftmap-transfer sync' to run"));
  }
  downloads_.push_back(action);
  downloads_.back().action_id = *id;
  Note(*id, ActionStatus::kWaiting);
  if (downloads_.size() == 1) HandOver(events);
  return OkStatus();
}

void FleetActions::HandOver(std::vector<Event>* events) {
  if (downloads_.empty()) return;
  log_.Set(downloads_.front().action_id, ActionStatus::kInitializing, "");
  events->emplace_back(downloads_.front());
}

Status FleetActions::Do(const MapDownloadProgress& progress, std::vector<Event>* events) {
  if (downloads_.empty() || downloads_.front().action_id != progress.action_id) {
    return NotFound("no download '{}' is under way", progress.action_id);
  }
  if (!progress.ended) {
    log_.Set(progress.action_id, ActionStatus::kRunning, "");
    return OkStatus();
  }
  if (progress.status.ok()) {
    // It was accepted earlier: errors since then stand.
    log_.Set(progress.action_id, ActionStatus::kFinished, "");
  } else {
    const bool known = progress.status.code() == StatusCode::kAlreadyExists;
    End(progress.action_id, progress.status, known ? kDuplicateMap : kInstantActionFailed)
        .IgnoreError();
  }
  downloads_.pop_front();
  HandOver(events);
  return OkStatus();
}

void FleetActions::SetDownloader(bool present) {
  downloader_ = present;
  if (present) return;
  for (const DownloadMap& download : downloads_) {
    End(download.action_id, Unavailable("the downloader is gone; another try goes on from here"))
        .IgnoreError();
  }
  downloads_.clear();
}

Status FleetActions::Do(const DeleteMap& action) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto id, Begin(action.action_id, "deleteMap"));
  if (!id) return OkStatus();
  const auto folder = Folder();
  if (!folder.ok()) return End(*id, folder.status(), kInvalidInstantAction);
  return End(*id, (*folder)->Remove(action.map_id, action.map_version));
}

void FleetActions::Fill(FleetState* state) const {
  if (folder_) {
    const auto maps = folder_->List();
    // A disk that does not answer has no maps to use either.
    if (maps.ok()) {
      for (const FolderMap& map : *maps) {
        state->maps.push_back({map.map_id, map.map_version, map.enabled});
      }
    }
  }
  state->errors = errors_;
  if (log_.overflowed()) {
    state->errors.push_back({"INSTANT_ACTION_STATES_FULL",
                             "URGENT",
                             "states of old actions were dropped, expected clearInstantActions",
                             {}});
  }
  state->actions = log_.actions();
}

}  // namespace shiftmap::live
