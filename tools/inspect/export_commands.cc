// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/codec/map_message.h"
#include "mapstore/core/atomic_file.h"
#include "mapstore/core/folder.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/map/map_version_name.h"
#include "mapstore/run/trajectory.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/map_export.h"
#include "tools/inspect/map_html.h"
#include "tools/inspect/store_arguments.h"
#include "tools/inspect/trajectory_export.h"

namespace shiftmap {
namespace {

struct ExportArguments {
  StoreArguments store;
  std::string output;
  bool geojson = false;
  bool csv = false;
  bool g2o = false;
  bool textproto = false;
  bool protojson = false;
  bool tum = false;
  bool snapshot = false;
  bool html = false;
  std::optional<std::string> run;
  std::optional<std::string> replay;
};

StatusOr<std::string> MapText(const ExportArguments& arguments,
                              const MapSnapshot& map,
                              MapStore* store) {
  if (arguments.csv) return MapCsv(map);
  if (arguments.html) return MapHtml(arguments.store, arguments.replay, store);
  if (arguments.textproto) return EncodeMap(map, MapForm::kText);
  if (arguments.protojson) return EncodeMap(map, MapForm::kJson);
  if (!arguments.g2o) return MapGeoJson(map);
  SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance,
                            store->LoadProvenance(map.area(), map.version()));
  return MapG2o(map, provenance);
}

Status ExportMap(const ExportArguments& arguments, MapStore* store, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments.store, store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, MapText(arguments, map, store));
  if (!context.dry_run()) SHIFTMAP_RETURN_IF_ERROR(WriteFileAtomically(arguments.output, text));
  context.Report({{"area", map.area()},
                  {"version", map.version().value()},
                  {"output", arguments.output},
                  {"bytes", text.size()}},
                 InertLine(arguments.output) + "\n");
  return OkStatus();
}

// The file of the run that is asked for, or a file per run in the folder.
StatusOr<std::vector<TrajectoryFile>> FilesToWrite(const ExportArguments& arguments,
                                                   const std::vector<RunRecord>& runs) {
  if (!arguments.run) return TrajectoryFiles(runs, arguments.output);
  SHIFTMAP_ASSIGN_OR_RETURN(const RunRecord* run, FindRun(runs, *arguments.run));
  if (run->trajectory.empty()) return std::vector<TrajectoryFile>();
  return std::vector<TrajectoryFile>{{run, arguments.output}};
}

Status ExportTrajectories(const ExportArguments& arguments, MapStore* store, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionNumber version, SelectVersion(arguments.store, store));
  SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance,
                            store->LoadProvenance(arguments.store.area, version));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<TrajectoryFile> files,
                            FilesToWrite(arguments, provenance.runs));
  if (files.empty()) {
    return NotFound(
        "area '{}': version {} holds no trajectory", arguments.store.area, version.value());
  }
  if (!context.dry_run() && !arguments.run) SHIFTMAP_RETURN_IF_ERROR(MakeFolder(arguments.output));
  Json written = Json::array();
  std::string text;
  for (const TrajectoryFile& file : files) {
    if (!context.dry_run()) {
      SHIFTMAP_RETURN_IF_ERROR(WriteTum(file.run->trajectory, file.path));
    }
    written.push_back({{"run", file.run->name},
                       {"identity", file.run->identity()},
                       {"output", file.path},
                       {"poses", file.run->trajectory.size()}});
    text += fmt::format("{}: {} poses\n", InertLine(file.path), file.run->trajectory.size());
  }
  context.Report(
      {{"area", arguments.store.area}, {"version", version.value()}, {"trajectories", written}},
      text);
  return OkStatus();
}

Status ExportSnapshot(const ExportArguments& arguments, MapStore* store, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments.store, store, context));
  std::string sha256;
  std::string name;
  if (!context.dry_run()) {
    SHIFTMAP_ASSIGN_OR_RETURN(sha256, store->ExportSnapshot(map.area(), arguments.output));
    name = MapVersionName(map.version(), map.content_hash(), sha256);
  }
  context.Report({{"area", map.area()},
                  {"version", map.version().value()},
                  {"output", arguments.output},
                  {"sha256", sha256},
                  {"map_version", name}},
                 InertLine(arguments.output) + "\n");
  return OkStatus();
}

Status RunExport(const ExportArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  if (arguments.tum) return ExportTrajectories(arguments, &store, context);
  if (arguments.snapshot) return ExportSnapshot(arguments, &store, context);
  return ExportMap(arguments, &store, context);
}

std::string CheckExport(const ExportArguments& arguments) {
  if (arguments.geojson + arguments.csv + arguments.g2o + arguments.textproto +
          arguments.protojson + arguments.tum + arguments.snapshot + arguments.html !=
      1) {
    return "export needs one of --geojson, --csv, --g2o, --tum, --textproto, --protojson, "
           "--snapshot and --html";
  }
  if (arguments.snapshot && (arguments.store.version || arguments.store.at_s)) {
    return "--snapshot is of the published version as it is now, without --version and --at";
  }
  if (arguments.run && !arguments.tum) return "--run is for --tum";
  if (arguments.replay && !arguments.html) return "--replay is for --html";
  return "";
}

}  // namespace

void AddExportCommand(Application* application) {
  auto arguments = std::make_shared<ExportArguments>();
  Command& command = application->AddCommand(
      "export", "Write a map in a format that other programs read", [arguments](Context& context) {
        return RunExport(*arguments, context);
      });
  AddMapOptions(&arguments->store, &command);
  AddKnownOption(&arguments->store, &command);
  command.Writes()
      .Flag("--geojson", &arguments->geojson, "Points with properties, in map coordinates")
      .Flag("--csv", &arguments->csv, "A line per mode")
      .Flag("--g2o", &arguments->g2o, "A graph of modes with their priors, and of fixed poses")
      .Flag("--tum", &arguments->tum, "The trajectories of the version's runs, thinned")
      .Flag("--textproto", &arguments->textproto, "The whole map, Protobuf's text form")
      .Flag("--protojson", &arguments->protojson, "The whole map, Protobuf's JSON form")
      .Flag("--snapshot", &arguments->snapshot, "The read-only map that a vehicle carries")
      .Flag("--html", &arguments->html, "A page for web browsers, which needs no network")
      .Option("--replay",
              &arguments->replay,
              "With --html: a shift to replay, a recording of shiftmap-localizer run")
      .Option("--run", &arguments->run, "With --tum: this run only, by name or identity")
      .Option("--output", &arguments->output, "File to write; with --tum without --run a folder")
      .Output()
      .Required()
      .Check([arguments] { return CheckExport(*arguments); });
}

}  // namespace shiftmap
