// SPDX-License-Identifier: Apache-2.0
//
// What a service does for the fleet's control: maps that change, a pose that is set, and its state.
#include <algorithm>
#include <utility>

#include "localizer/live/service.h"

namespace shiftmap::live {
namespace {

constexpr double kRegionProbability = 0.95;

// How long landmarks have to confirm a pose.
constexpr double kConfirmS = 10.0;

// Without items for as long, nobody knows whether the vehicle stands.
constexpr double kSilentS = 1.0;

Status Unknown(const std::string& map_id) {
  return NotFound("no map of '{}' is enabled here", map_id);
}

// An action on maps and its type in the standard; null for any other command.
std::pair<const MapAction*, const char*> MapActionOf(const Command& command) {
  if (const auto* download = std::get_if<DownloadMap>(&command)) return {download, "downloadMap"};
  if (const auto* enable = std::get_if<EnableMap>(&command)) return {enable, "enableMap"};
  return {std::get_if<DeleteMap>(&command), "deleteMap"};
}

}  // namespace

Status Service::CheckOwner(const Request& request) {
  const auto [action, type] = MapActionOf(request.command);
  if (action == nullptr || !options_.has_map_owner || request.from_map_owner) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const auto id, fleet_.Begin(action->action_id, type));
  const Status refused = FailedPrecondition(
      "map '{}': the daemon of the map server changes maps (map_source = server), nobody else",
      action->map_id);
  return id ? fleet_.End(*id, refused, kInvalidInstantAction) : refused;
}

StatusOr<Service::LoadedMap> Service::Loaded(const FolderMap& file) {
  SHIFTMAP_ASSIGN_OR_RETURN(const MapFolder* folder, fleet_.Folder());
  SHIFTMAP_ASSIGN_OR_RETURN(MapUse use, folder->Use(file));
  SHIFTMAP_ASSIGN_OR_RETURN(MapSnapshot map, LoadLiveMap(file.path, file.map_id));
  return LoadedMap{std::move(map), file, std::move(use)};
}

Status Service::TakeUpEnabledMap() {
  SHIFTMAP_ASSIGN_OR_RETURN(const MapFolder* folder, fleet_.Folder());
  SHIFTMAP_ASSIGN_OR_RETURN(const auto file, folder->Enabled(area_));
  if (!file) {
    map_.reset();
    return NotFound("map folder '{}': no map of area '{}' is enabled", folder->path(), area_);
  }
  if (map_ && map_->file->sha256 == file->sha256) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(LoadedMap map, Loaded(*file));
  TakeUp(std::move(map));
  return OkStatus();
}

void Service::TakeUp(LoadedMap map) {
  area_ = map.map.area();
  map_ = std::move(map);
}

bool Service::Stands() const {
  return !shift_ || (shift_->Stands() &&
                     ToSeconds(time_line_.SinceAccepted(options_.steady_clock())) < kSilentS);
}

bool Service::MustWait(const FolderMap& file) const {
  const bool changes = file.map_id == area_ && shift_ && map_->file->sha256 != file.sha256;
  return changes && !Stands();
}

Status Service::Do(const EnableMap& action, std::vector<Event>* events) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto id, fleet_.Begin(action.action_id, "enableMap"));
  if (!id) return OkStatus();
  const auto folder = fleet_.Folder();
  if (!folder.ok()) return fleet_.End(*id, folder.status(), kInvalidInstantAction);
  const auto file = (*folder)->Find(action.map_id, action.map_version);
  if (!file.ok()) return fleet_.End(*id, file.status(), kUnknownMapId);
  if (action.map_id == area_ && waiting_) {
    fleet_
        .End(waiting_->action_id,
             MakeStatus(StatusCode::kAborted, "another enableMap came: '{}'", *id))
        .IgnoreError();
    waiting_.reset();
  }
  if (!MustWait(*file)) return fleet_.End(*id, Enable(*file, events));
  waiting_ = action;
  waiting_->action_id = *id;
  fleet_.Note(*id, ActionStatus::kWaiting, "until the vehicle stands or the shift ends");
  return OkStatus();
}

// Loaded before it is enabled: a map that cannot be read changes nothing.
Status Service::Enable(const FolderMap& file, std::vector<Event>* events) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapFolder * folder, fleet_.Folder());
  const bool in_use = map_ && map_->file->sha256 == file.sha256;
  if (file.map_id != area_ || in_use) return folder->Enable(file.map_id, file.map_version);
  SHIFTMAP_ASSIGN_OR_RETURN(LoadedMap map, Loaded(file));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto before, folder->Enabled(file.map_id));
  SHIFTMAP_RETURN_IF_ERROR(folder->Enable(file.map_id, file.map_version));
  if (!shift_) {
    TakeUp(std::move(map));
    return options_.start && last_uuid_.empty() ? Do(Start(), events) : OkStatus();
  }
  const Stamp now = shift_->now();
  const auto pose =
      time_line_.verdict() == TimeLine::kAgrees ? shift_->PoseAfter(0.0) : std::nullopt;
  const Status status = BeginNextShift(std::move(map), pose);
  if (status.ok()) {
    events->emplace_back(StateEvent{now, LocalizerState::kInitializing});
  } else if (shift_ && before) {
    // The disk did not take the report: the shift goes on, on its map.
    SHIFTMAP_RETURN_IF_ERROR(folder->Enable(before->map_id, before->map_version));
  }
  return status;
}

Status Service::Do(const InitializePosition& action, std::vector<Event>* events) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto id, fleet_.Begin(action.action_id, "initializePosition"));
  if (!id) return OkStatus();
  const Status status = Position(action, events);
  if (!status.ok() || !action.check) {
    const bool unknown = status.code() == StatusCode::kNotFound;
    return fleet_.End(*id, status, unknown ? kUnknownMapId : kInstantActionFailed);
  }
  if (pose_check_) {
    const Status other = MakeStatus(StatusCode::kAborted, "another pose was set: '{}'", *id);
    fleet_.End(pose_check_->action_id, other).IgnoreError();
  }
  pose_check_ = PoseCheck{*id, shift_->now(), shift_->localizer().Statistics().scans};
  fleet_.Note(*id, ActionStatus::kRunning, "until landmarks agree with the pose");
  return OkStatus();
}

Status Service::Position(const InitializePosition& action, std::vector<Event>* events) {
  if (action.map_id == area_) {
    if (!shift_) return FailedPrecondition("no shift is under way, expected a start first");
    return Do(InitializePose{action.pose}, events);
  }
  const auto folder = fleet_.Folder();
  if (!folder.ok()) return Unknown(action.map_id);
  SHIFTMAP_ASSIGN_OR_RETURN(const auto file, (*folder)->Enabled(action.map_id));
  if (!file) return Unknown(action.map_id);
  if (!shift_) return FailedPrecondition("no shift is under way, expected a start first");
  if (!Stands()) {
    return FailedPrecondition("the vehicle drives, expected it to stand to go to another map");
  }
  SHIFTMAP_ASSIGN_OR_RETURN(LoadedMap map, Loaded(*file));
  const Stamp now = shift_->now();
  SHIFTMAP_RETURN_IF_ERROR(BeginNextShift(std::move(map), action.pose));
  events->emplace_back(StateEvent{now, LocalizerState::kInitializing});
  return OkStatus();
}

Status Service::Do(const ClearActions&, std::vector<Event>*) {
  fleet_.Clear();
  return OkStatus();
}

void Service::StepCallback(std::vector<Event>* events) {
  CheckPose();
  if (!waiting_ || !Stands()) return;
  const EnableMap action = *std::exchange(waiting_, std::nullopt);
  const auto folder = fleet_.Folder();
  auto file = (*folder)->Find(action.map_id, action.map_version);
  const std::size_t first = events->size();
  const Status status = file.ok() ? Enable(*file, events) : file.status();
  if (!fleet_.End(action.action_id, status).ok()) options_.warn(Message(status));
  Inform(*events, first);
}

void Service::CheckPose() {
  if (!pose_check_) return;
  const auto end = [&](const Status& status) {
    fleet_.End(pose_check_->action_id, status).IgnoreError();
    pose_check_.reset();
  };
  if (!shift_) return end(MakeStatus(StatusCode::kAborted, "the shift ended"));
  const Localizer& localizer = shift_->localizer();
  const double elapsed_s = ToSeconds(shift_->now() - pose_check_->begin);
  if (localizer.Statistics().scans > pose_check_->scans) {
    if (localizer.Support().Confirms()) return end(OkStatus());
    if (localizer.state() == LocalizerState::kLost) {
      return end(FailedPrecondition("landmarks contradict the pose"));
    }
  }
  if (elapsed_s > kConfirmS) {
    const PoseSupport support = localizer.Support();
    end(FailedPrecondition("{} landmarks agree with the pose and {} do not after {:.0f} s",
                           support.agreeing,
                           support.failing,
                           elapsed_s));
  }
}

FleetState Service::Fleet() const {
  FleetState state;
  fleet_.Fill(&state);
  if (!fleet_.has_folder()) {
    const MapSnapshot& map = map_->map;
    state.maps = {{map.area(), MapVersionName(map.version(), map.content_hash(), ""), true}};
  }
  state.map_id = area_;
  state.T_map_vehicle = last_pose_;
  const ServiceState now = State();
  const auto pose = shift_ ? shift_->Pose() : std::nullopt;
  if (pose) state.T_map_vehicle = pose->pose.T_map_vehicle;
  state.localized = now.pose && now.localizer_state != LocalizerState::kLost &&
                    now.localizer_state != LocalizerState::kInitializing;
  if (state.localized) {
    state.localization_score = shift_->Score();
    state.deviation_range_m = shift_->RadiusHolding(kRegionProbability);
  } else {
    state.errors.push_back(
        {"LOCALIZATION_ERROR",
         "FATAL",
         shift_ ? fmt::format("{}: no pose can be trusted", ToString(now.localizer_state))
                : "no shift is under way",
         {}});
  }
  return state;
}

}  // namespace shiftmap::live
