// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <iostream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>

#include "localizer/cli/commands.h"
#include "localizer/cli/hypothesis_json.h"
#include "localizer/cli/initial_pose.h"
#include "localizer/cli/service_json.h"
#include "localizer/cli/vda5050_json.h"
#include "localizer/live/client.h"
#include "mapstore/codec/run_log.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/core/parse_whole.h"

namespace shiftmap {
namespace {

constexpr std::chrono::milliseconds kLookEvery(100);

struct CtlOptions {
  std::string socket;
  std::string verb;
  std::optional<std::string> argument;
  std::string vehicle;
  std::optional<double> odometer_m;
  std::string map_version;
  std::string content_hash;
  std::string map_id;
  std::string link;
  std::string sha256;
  std::string action_id;
  bool check = false;
  double wait_s = 0.0;
  double rate = 0.0;
  std::int64_t count = 0;
};

// Verbs and what their argument is; nullptr: they take none.
const std::map<std::string, const char*>& Verbs() {
  static const std::map<std::string, const char*> verbs = {{"state", nullptr},
                                                           {"hypotheses", nullptr},
                                                           {"start", nullptr},
                                                           {"stop", nullptr},
                                                           {"stop-and-save", nullptr},
                                                           {"set-map", "AREA"},
                                                           {"initialize-pose", "X,Y,YAW"},
                                                           {"initialize-position", "X,Y,YAW"},
                                                           {"download-map", "LINK"},
                                                           {"enable-map", nullptr},
                                                           {"delete-map", nullptr},
                                                           {"clear-actions", nullptr},
                                                           {"vda5050-state", nullptr},
                                                           {"subscribe", nullptr},
                                                           {"feed", "RUN.mcap or -"}};
  return verbs;
}

// Of set-map, which counts versions.
std::optional<std::int64_t> VersionOf(const CtlOptions& options) {
  return ParseWhole<std::int64_t>(options.map_version);
}

bool NamesAMap(const std::string& verb) { return verb.ends_with("-map") && verb != "set-map"; }

std::string CheckOptions(const CtlOptions& options) {
  const auto verb = Verbs().find(options.verb);
  if (verb == Verbs().end()) {
    std::string names;
    for (const auto& [name, argument] : Verbs()) names += (names.empty() ? "" : ", ") + name;
    return fmt::format("verb '{}', expected one of {}", options.verb, names);
  }
  if (verb->second == nullptr && options.argument) return options.verb + " takes no argument";
  if (verb->second != nullptr && !options.argument) {
    return fmt::format("{} needs {}", options.verb, verb->second);
  }
  if (options.verb.starts_with("initialize-po") && !ParseInitialPose(*options.argument)) {
    return fmt::format("pose '{}', expected X,Y,YAW", *options.argument);
  }
  if (NamesAMap(options.verb) && (options.map_id.empty() || options.map_version.empty())) {
    return options.verb + " needs --map-id and --map-version";
  }
  if (options.verb == "initialize-position" && options.map_id.empty()) {
    return "initialize-position needs --map-id";
  }
  if (options.verb == "set-map" && !options.map_version.empty() && !VersionOf(options)) {
    return fmt::format("--map-version '{}', expected a whole number", options.map_version);
  }
  return "";
}

live::Command MapCommandOf(const CtlOptions& options) {
  const live::MapAction action{options.action_id, options.map_id, options.map_version};
  if (options.verb == "download-map") {
    return live::DownloadMap{action, *options.argument, options.sha256};
  }
  if (options.verb == "enable-map") return live::EnableMap{action};
  return live::DeleteMap{action};
}

live::Command CommandOf(const CtlOptions& options) {
  if (options.verb == "start") {
    return live::Start{.vehicle = options.vehicle, .odometer_m = options.odometer_m};
  }
  if (options.verb == "stop") return live::Stop{.save_pose = false};
  if (options.verb == "stop-and-save") return live::Stop{.save_pose = true};
  if (options.verb == "initialize-pose") {
    return live::InitializePose{*ParseInitialPose(*options.argument)};
  }
  if (options.verb == "set-map") {
    live::SetMap map{
        .area = *options.argument, .version = std::nullopt, .content_hash = options.content_hash};
    if (const auto version = VersionOf(options)) map.version = VersionNumber(*version);
    return map;
  }
  if (NamesAMap(options.verb)) return MapCommandOf(options);
  if (options.verb == "initialize-position") {
    return live::InitializePosition{.action_id = options.action_id,
                                    .map_id = options.map_id,
                                    .pose = *ParseInitialPose(*options.argument),
                                    .check = options.check};
  }
  if (options.verb == "clear-actions") return live::ClearActions();
  if (options.verb == "vda5050-state") return live::GetFleetState();
  return live::GetState{.hypotheses = options.verb == "hypotheses"};
}

// Sends the items of a run log, at `rate` times their own pace or, for 0, as fast as they go.
Status Feed(const std::string& path, double rate, live::Client* client) {
  SHIFTMAP_ASSIGN_OR_RETURN(RunLogStream stream, RunLogStream::Open(path));
  std::optional<Stamp> first;
  const auto begin = std::chrono::steady_clock::now();
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<RunEvent> item, stream.Next());
    if (!item) return OkStatus();
    if (!first) first = StampOf(*item);
    if (rate > 0.0) {
      std::this_thread::sleep_until(begin + FromSeconds(ToSeconds(StampOf(*item) - *first) / rate));
    }
    SHIFTMAP_RETURN_IF_ERROR(client->Send(
        {.id = 0,
         .command = std::visit([](const auto& value) { return live::Command(value); }, *item)}));
  }
}

// Says which items the service did not take in between two of its states.
void AttendToRefused(const live::ServiceState& before,
                     const live::ServiceState& after,
                     Context* context) {
  for (const char* reason : {"no_shift", "late", "future", "invalid", "bad_request"}) {
    const auto count = [&](const live::ServiceState& state) {
      const auto entry = std::find_if(
          state.dropped.begin(), state.dropped.end(), [&](const DroppedCount& dropped) {
            return dropped.reason == reason;
          });
      return entry == state.dropped.end() ? 0 : entry->count;
    };
    const std::int64_t refused = count(after) - count(before);
    if (refused > 0)
      context->Attend(fmt::format("{} items were not taken in: {}", refused, reason));
  }
}

// Events as they come, or with --json all of them at the end.
Status Follow(const CtlOptions& options, live::Client* client, Context* context) {
  const live::Subscribe all{.poses = true, .states = true, .decisions = true};
  SHIFTMAP_RETURN_IF_ERROR(client->Call(all).status());
  Json events = Json::array();
  for (std::int64_t i = 0; options.count == 0 || i < options.count; ++i) {
    const auto event = client->Receive();
    if (!event.ok()) break;
    if (context->json()) {
      events.push_back(EventJson(*event));
    } else {
      std::cout << EventText(*event) << std::flush;
    }
  }
  context->Report({{"events", events}}, "");
  return OkStatus();
}

// The state once an action has ended, or the time is over.
StatusOr<live::FleetState> Ended(const std::string& action_id,
                                 double wait_s,
                                 live::FleetState state,
                                 live::Client* client) {
  const auto until = std::chrono::steady_clock::now() + FromSeconds(wait_s);
  for (;;) {
    const auto action = std::find_if(state.actions.begin(),
                                     state.actions.end(),
                                     [&](const auto& a) { return a.action_id == action_id; });
    if (action == state.actions.end()) return state;
    if (action->status == live::ActionStatus::kFailed) {
      return FailedPrecondition("{} failed: {}", action->type, action->result);
    }
    if (action->ended() || std::chrono::steady_clock::now() >= until) return state;
    std::this_thread::sleep_for(kLookEvery);
    SHIFTMAP_ASSIGN_OR_RETURN(const live::Reply reply, client->Call(live::GetFleetState()));
    if (reply.fleet_state) state = *reply.fleet_state;
  }
}

Status Act(const CtlOptions& options,
           live::Command command,
           live::Client* client,
           Context* context) {
  // A name of ours, to find the action again.
  std::string action_id = options.action_id.empty() ? RandomUuid() : options.action_id;
  std::visit(
      [&](auto& action) {
        if constexpr (requires { action.action_id; }) action.action_id = action_id;
      },
      command);
  SHIFTMAP_ASSIGN_OR_RETURN(const live::Reply reply, client->Call(command));
  if (!std::holds_alternative<live::GetFleetState>(command)) context->NoteEffect();
  if (!reply.fleet_state) return Internal("service replied without its state");
  SHIFTMAP_ASSIGN_OR_RETURN(const live::FleetState state,
                            Ended(action_id, options.wait_s, *reply.fleet_state, client));
  context->Report(Vda5050Json(state), Vda5050Text(state));
  return OkStatus();
}

Status Say(const CtlOptions& options, live::Client* client, Context* context) {
  if (options.verb == "subscribe") return Follow(options, client, context);
  std::optional<live::ServiceState> before;
  if (options.verb == "feed") {
    SHIFTMAP_ASSIGN_OR_RETURN(const live::Reply reply, client->Call(live::GetState()));
    before = reply.state;
    SHIFTMAP_RETURN_IF_ERROR(Feed(*options.argument, options.rate, client));
  }
  const live::Command command = CommandOf(options);
  if (live::AsksForFleetState(command)) return Act(options, command, client, context);
  SHIFTMAP_ASSIGN_OR_RETURN(const live::Reply reply, client->Call(command));
  if (options.verb == "feed" || !std::holds_alternative<live::GetState>(command)) {
    context->NoteEffect();
  }
  if (options.verb == "hypotheses") {
    if (!reply.hypotheses) return NotFound("no hypotheses, expected a shift that has a pose");
    context->Report(HypothesisJson(*reply.hypotheses), HypothesisText(*reply.hypotheses));
    return OkStatus();
  }
  if (!reply.state) return Internal("service replied without its state");
  if (before) AttendToRefused(*before, *reply.state, context);
  context->Report(ServiceJson(*reply.state), ServiceText(*reply.state));
  return OkStatus();
}

Status Ctl(const CtlOptions& options, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(live::Client client, live::Client::Connect(options.socket));
  return Annotate(Say(options, &client, &context), "socket '{}'", options.socket);
}

}  // namespace

void AddCtlCommand(Application* application) {
  auto options = std::make_shared<CtlOptions>();
  application
      ->AddCommand("ctl",
                   "Say one thing to a service, or feed it a run log",
                   [options](Context& context) { return Ctl(*options, context); })
      .Option("--socket", &options->socket, "Unix socket that the service listens on")
      .Required()
      .Option("VERB",
              &options->verb,
              "state, hypotheses, start, stop, stop-and-save, set-map, initialize-pose, subscribe, "
              "feed, download-map, enable-map, delete-map, initialize-position, clear-actions, "
              "vda5050-state")
      .Required()
      .Option("ARGUMENT", &options->argument, "AREA, X,Y,YAW, LINK or RUN.mcap")
      .Option("--vehicle", &options->vehicle, "start: name of the vehicle")
      .Option("--odometer-m", &options->odometer_m, "start: what the odometer shows")
      .Option("--map-id", &options->map_id, "Area of a map action")
      .Option("--map-version",
              &options->map_version,
              "Name of the map, e.g. 3-0a1b2c3d-4e5f6071; set-map: number of the version, default: "
              "the published one")
      .Option("--sha256", &options->sha256, "download-map: what the file's must be")
      .Option("--action-id", &options->action_id, "Name of an action; one that comes again is done")
      .Flag("--check", &options->check, "initialize-position: until landmarks agree with the pose")
      .Option("--wait-s", &options->wait_s, "Wait this long for an action to end")
      .InRange(0.0, 1e6)
      .Option("--content-hash", &options->content_hash, "set-map: what the map's must be")
      .Option("--rate", &options->rate, "feed: times real time; 0: as fast as it goes")
      .InRange(0.0, 1e6)
      .Option("--count", &options->count, "subscribe: events to wait for; 0: until the end")
      .InRange(0, 1e12)
      .Check([options] { return CheckOptions(*options); });
}

}  // namespace shiftmap
