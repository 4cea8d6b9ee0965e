// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <nlohmann/json.hpp>

#include "mapstore/core/atomic_file.h"
#include "mapstore/core/inert_text.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/map_export.h"
#include "tools/inspect/store_arguments.h"
#include "tools/plot/map_plot.h"

namespace shiftmap {
namespace {

struct OutputArguments {
  StoreArguments store;
  std::string output;
};

struct ExportArguments : OutputArguments {
  bool geojson = false;
  bool csv = false;
  bool snapshot = false;
};

struct PlotArguments : OutputArguments {
  std::string what = "map";
};

// Writes the text, unless nothing may be written, and reports.
Status Finish(const MapSnapshot& map,
              const std::string& path,
              const std::string& text,
              Context& context) {
  if (!context.dry_run()) SHIFTMAP_RETURN_IF_ERROR(WriteFileAtomically(path, text));
  context.Report({{"area", map.area()},
                  {"version", map.version().value()},
                  {"output", path},
                  {"bytes", text.size()}},
                 InertLine(path) + "\n");
  return OkStatus();
}

Status RunExport(const ExportArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments.store, &store));
  if (!arguments.snapshot) {
    return Finish(map, arguments.output, arguments.csv ? MapCsv(map) : MapGeoJson(map), context);
  }
  std::string sha256;
  if (!context.dry_run()) {
    SHIFTMAP_ASSIGN_OR_RETURN(sha256, store.ExportSnapshot(map.area(), arguments.output));
  }
  context.Report({{"area", map.area()},
                  {"version", map.version().value()},
                  {"output", arguments.output},
                  {"sha256", sha256}},
                 InertLine(arguments.output) + "\n");
  return OkStatus();
}

Status RunPlot(const PlotArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments.store, &store));
  SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance,
                            store.LoadProvenance(map.area(), map.version()));
  return Finish(map, arguments.output, PlotMap(map, provenance), context);
}

std::string CheckExport(const ExportArguments& arguments) {
  if (arguments.geojson + arguments.csv + arguments.snapshot != 1) {
    return "export needs one of --geojson, --csv and --snapshot";
  }
  if (arguments.snapshot && (arguments.store.version || arguments.store.at_s)) {
    return "--snapshot is of the published version as it is now, without --version and --at";
  }
  return "";
}

}  // namespace

void AddPictureCommands(Application* application) {
  auto exported = std::make_shared<ExportArguments>();
  Command& export_command = application->AddCommand(
      "export", "Write a map in a format that other programs read", [exported](Context& context) {
        return RunExport(*exported, context);
      });
  AddMapOptions(&exported->store, &export_command);
  AddKnownOption(&exported->store, &export_command);
  export_command.Writes()
      .Flag("--geojson", &exported->geojson, "Points with properties, in map coordinates")
      .Flag("--csv", &exported->csv, "A line per mode")
      .Flag("--snapshot", &exported->snapshot, "The read-only map that a vehicle carries")
      .Option("--output", &exported->output, "File to write")
      .Required()
      .Check([exported] { return CheckExport(*exported); });

  auto plot = std::make_shared<PlotArguments>();
  Command& plot_command =
      application->AddCommand("plot", "Draw a picture as SVG", [plot](Context& context) {
        return RunPlot(*plot, context);
      });
  AddMapOptions(&plot->store, &plot_command);
  AddKnownOption(&plot->store, &plot_command);
  plot_command.Writes()
      .Option("WHAT", &plot->what, "What to draw: map")
      .OneOf({"map"})
      .Option("--output", &plot->output, "File to write")
      .Required();
}

void AddInspectCommands(Application* application) {
  AddListCommands(application);
  AddLedgerCommands(application);
  AddRunCommands(application);
  AddEditCommands(application);
  AddMapCommands(application);
  AddPictureCommands(application);
  AddVersionCommands(application);
  AddMaintenanceCommands(application);
}

}  // namespace shiftmap
