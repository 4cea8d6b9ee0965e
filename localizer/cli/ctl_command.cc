// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <chrono>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "localizer/cli/commands.h"
#include "localizer/cli/hypothesis_json.h"
#include "localizer/cli/initial_pose.h"
#include "localizer/cli/service_json.h"
#include "localizer/live/client.h"
#include "mapstore/codec/run_log.h"

namespace shiftmap {
namespace {

struct CtlOptions {
  std::string socket;
  std::string verb;
  std::optional<std::string> argument;
  std::string vehicle;
  std::optional<double> odometer_m;
  std::optional<std::int64_t> version;
  std::string content_hash;
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
                                                           {"subscribe", nullptr},
                                                           {"feed", "RUN.mcap or -"}};
  return verbs;
}

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
  if (options.verb == "initialize-pose" && !ParseInitialPose(*options.argument)) {
    return fmt::format("pose '{}', expected X,Y,YAW", *options.argument);
  }
  return "";
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
    if (options.version) map.version = VersionNumber(*options.version);
    return map;
  }
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

Status Say(const CtlOptions& options, live::Client* client, Context* context) {
  if (options.verb == "subscribe") return Follow(options, client, context);
  if (options.verb == "feed") {
    SHIFTMAP_RETURN_IF_ERROR(Feed(*options.argument, options.rate, client));
  }
  const live::Command command = CommandOf(options);
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
  context->Report(ServiceJson(*reply.state), ServiceText(*reply.state));
  return OkStatus();
}

Status Ctl(const CtlOptions& options, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(live::Client client, live::Client::Connect(options.socket));
  const Status status = Say(options, &client, &context);
  if (status.ok()) return status;
  return MakeStatus(status.code(), "socket '{}': {}", options.socket, Message(status));
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
              "feed")
      .Required()
      .Option("ARGUMENT", &options->argument, "AREA, X,Y,YAW or RUN.mcap")
      .Option("--vehicle", &options->vehicle, "start: name of the vehicle")
      .Option("--odometer-m", &options->odometer_m, "start: what the odometer shows")
      .Option("--map-version", &options->version, "set-map: version; default: the published one")
      .Option("--content-hash", &options->content_hash, "set-map: what the map's must be")
      .Option("--rate", &options->rate, "feed: times real time; 0: as fast as it goes")
      .InRange(0.0, 1e6)
      .Option("--count", &options->count, "subscribe: events to wait for; 0: until the end")
      .InRange(0, 1e12)
      .Check([options] { return CheckOptions(*options); });
}

}  // namespace shiftmap
