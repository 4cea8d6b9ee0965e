// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <nlohmann/json.hpp>

#include "mapstore/core/atomic_file.h"
#include "mapstore/core/inert_text.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/store_arguments.h"
#include "tools/plot/map_plot.h"

namespace shiftmap {
namespace {

struct OutputArguments {
  StoreArguments store;
  std::string output;
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

Status RunPlot(const PlotArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments.store, &store));
  SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance,
                            store.LoadProvenance(map.area(), map.version()));
  return Finish(map, arguments.output, PlotMap(map, provenance), context);
}

}  // namespace

void AddPictureCommands(Application* application) {
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
  AddMapCommands(application);
  AddExportCommand(application);
  AddPictureCommands(application);
  AddVersionCommands(application);
  AddViewCommands(application);
  AddMaintenanceCommands(application);
}

}  // namespace shiftmap
