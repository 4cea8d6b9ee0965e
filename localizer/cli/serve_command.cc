// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <atomic>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "localizer/cli/commands.h"
#include "localizer/cli/localizer_arguments.h"
#include "localizer/cli/service_json.h"
#include "localizer/live/server.h"
#include "localizer/recording/journal_recording.h"
#include "mapstore/cli/input_options.h"
#include "mapstore/cli/version.h"
#include "mapstore/core/clock.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap {
namespace {

struct ServeOptions {
  std::optional<std::string> store;
  std::optional<std::string> snapshot;
  std::optional<std::string> maps;
  std::string map_source = "none";
  std::string area;
  std::string socket;
  std::optional<std::string> state_dir;
  std::string vehicle = "vehicle";
  std::string content_hash;
  bool start = false;
  double max_pose_age_s = live::ServiceOptions().max_pose_age_s;
  // Drivers of sensors deliver out of step.
  LocalizerArguments localizer{.max_delay_s = 0.2};
  double step_budget_ms = live::ServiceOptions().step_budget_ms;
  std::int64_t log_quota_mib = live::ServiceOptions().max_log_bytes >> 20;
  std::optional<std::string> recording;
  std::int64_t recording_quota_mib = 1024;
};

std::string StateFolderOf(const ServeOptions& options) {
  return options.state_dir.value_or(options.socket + ".state");
}

// Logs and recordings have the same names.
bool RecordsIntoStateFolder(const ServeOptions& options) {
  const auto absolute = [](const std::string& path) {
    std::error_code error;
    const std::filesystem::path whole = std::filesystem::weakly_canonical(path + "/", error);
    return error ? std::filesystem::path(path) : whole;
  };
  return options.recording && absolute(*options.recording) == absolute(StateFolderOf(options));
}

std::string CheckOptions(const ServeOptions& options) {
  const int sources = options.store.has_value() + options.snapshot.has_value();
  if (options.maps ? options.snapshot.has_value() : sources != 1) {
    return "give one of --store, --snapshot and --maps";
  }
  if (options.maps && !options.content_hash.empty()) {
    return "--content-hash goes with --store or --snapshot";
  }
  if (std::string wrong = options.localizer.Check(); !wrong.empty()) return wrong;
  if (RecordsIntoStateFolder(options)) {
    return fmt::format("--recording '{}': is the state folder, expected another one",
                       *options.recording);
  }
  return Message(CheckReportText("--vehicle", options.vehicle));
}

live::ServiceOptions ServiceOptionsOf(const ServeOptions& options) {
  live::ServiceOptions service;
  if (options.maps) {
    service.map_folder = *options.maps;
    service.has_map_owner = options.map_source == "server";
  } else {
    service.map_path = options.store ? *options.store : *options.snapshot;
  }
  service.start = options.start;
  service.area = options.area;
  service.content_hash = options.content_hash;
  service.state_dir = StateFolderOf(options);
  service.vehicle = options.vehicle;
  service.software = "shiftmap-localizer " + SoftwareVersion();
  service.localizer = options.localizer.Options();
  service.max_pose_age_s = options.max_pose_age_s;
  service.step_budget_ms = options.step_budget_ms;
  service.max_log_bytes = options.log_quota_mib << 20;
  if (options.recording) {
    service.recordings = {*options.recording, options.recording_quota_mib << 20, {}};
    service.recordings.make = [service](const std::string& journal,
                                        const std::string& path,
                                        const std::atomic<bool>& stop) {
      const auto map_of = [&](const live::ShiftHeader& header) {
        return live::LoadMapOfShift(service, header);
      };
      return RecordJournal(journal, map_of, service.software, path, stop);
    };
  }
  service.clock = SystemNow;
  return service;
}

Status Serve(const ServeOptions& options, Context& context) {
  ServiceNotifier notifier;
  live::ServiceOptions service_options = ServiceOptionsOf(options);
  service_options.warn = [&context](const std::string& message) { context.Warn(message); };
  service_options.inform = [&context](const std::string& message) { context.Inform(message); };
  service_options.resuming = [&notifier] { notifier.StillStarting(); };
  // The socket first: two services must not take up one shift.
  SHIFTMAP_ASSIGN_OR_RETURN(live::Server server, live::Server::Listen(options.socket, &notifier));
  SHIFTMAP_ASSIGN_OR_RETURN(live::Service service, live::Service::Open(service_options));
  if (options.start && !service.State().running) {
    std::vector<live::Event> events;
    const live::Reply started = service.Handle({.id = 0, .command = live::Start()}, &events);
    // With a folder, it begins once a map is enabled.
    if (!options.maps) SHIFTMAP_RETURN_IF_ERROR(started.status);
  }
  SHIFTMAP_RETURN_IF_ERROR(server.Run(&service));
  context.Report(ServiceJson(service.State()), ServiceText(service.State()));
  return OkStatus();
}

}  // namespace

void AddServeCommand(Application* application) {
  auto options = std::make_shared<ServeOptions>();
  Command& command =
      application->AddCommand("serve",
                              "Localize a live vehicle that talks over a Unix socket",
                              [options](Context& context) { return Serve(*options, context); });
  AddLimitOptions(&options->localizer.limits, &command);
  command.Option("--store", &options->store, "Map store to take the published version from")
      .Option("--snapshot", &options->snapshot, "Snapshot file to take the map from")
      .Option("--maps",
              &options->maps,
              "Folder of maps to take the enabled map of the area from; a --store is not used then")
      .Option("--map-source",
              &options->map_source,
              "Who changes maps of the folder: server: `shiftmap-transfer sync` alone; vda5050, "
              "none: any client that asks")
      .OneOf({"none", "server", "vda5050"})
      .Option("--area", &options->area, "Area to localize in")
      .Required()
      .Option("--socket", &options->socket, "Unix socket to listen on")
      .Required()
      .Option("--state-dir",
              &options->state_dir,
              "Folder for journal, saved pose and reports; default: the socket's path and .state")
      .Option("--vehicle", &options->vehicle, "Name of the vehicle in the fleet")
      .Option("--content-hash", &options->content_hash, "The map must have this content hash")
      .Option("--initial-pose", &options->localizer.initial_pose, "X,Y,YAW in m, m, rad, or auto")
      .Flag("--start", &options->start, "Begin a shift at once");
  AddHypothesisOptions(&options->localizer, &command);
  command.Option("--max-pose-age-s", &options->max_pose_age_s, "Oldest saved pose that is used")
      .InRange(0.0, 1e9)
      .Option("--max-delay-s",
              &options->localizer.max_delay_s,
              "Wait this long for odometry and scans that come late; 0: they come in order")
      .InRange(0.0, 60.0)
      .Option("--log-quota-mib",
              &options->log_quota_mib,
              "Run logs of shifts are kept in the state folder up to this; 0: none")
      .InRange(0, 1 << 30)
      .Option("--recording",
              &options->recording,
              "Folder to record each shift in for Foxglove and `view --replay`, after its end, as "
              "<uuid>.mcap; not the state folder")
      .Option("--recording-quota-mib",
              &options->recording_quota_mib,
              "The oldest recordings in that folder are deleted beyond this")
      .InRange(1, 1 << 30)
      .Option("--step-budget-ms", &options->step_budget_ms, "A longer step counts as an overrun")
      .InRange(1e-3, 1e6)
      .Check([options] { return CheckOptions(*options); });
}

}  // namespace shiftmap
