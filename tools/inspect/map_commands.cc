// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <nlohmann/json.hpp>

#include "mapstore/cli/aligned_table.h"
#include "mapstore/core/count_text.h"
#include "mapstore/core/inert_text.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/landmark_text.h"
#include "tools/inspect/map_export.h"
#include "tools/inspect/store_arguments.h"
#include "tools/inspect/vehicle_table.h"

namespace shiftmap {
namespace {

std::string ProbabilityText(double probability) { return fmt::format("{:.4f}", probability); }

std::string MapText(const MapSnapshot& map, const TextStyle& style) {
  AlignedTable table({"signature", "mode", "x_m", "y_m", "probability", "now", "last_seen"});
  for (const LandmarkGroup& group : map.groups()) {
    const auto now = [&](Eigen::Index state) {
      return IsDecided(group.probabilities(state)) ? "*" : "";
    };
    table.AddRow({group.signature.text(),
                  "0",
                  "-",
                  "-",
                  ProbabilityText(group.probabilities(0)),
                  now(0),
                  "-"});
    for (std::size_t i = 0; i < group.modes.size(); ++i) {
      const Mode& mode = group.modes[i];
      const auto state = static_cast<Eigen::Index>(i + 1);
      table.AddRow({group.signature.text(),
                    fmt::format("{}", mode.number.value()),
                    fmt::format("{:.3f}", mode.p_map_landmark.x()),
                    fmt::format("{:.3f}", mode.p_map_landmark.y()),
                    ProbabilityText(group.probabilities(state)),
                    now(state),
                    TimeText(mode.last_seen)});
    }
  }
  return fmt::format(
      "area {}, version {}, content {}\nprobabilities at {} UTC; {}, {} "
      "anonymous, {}\n\n{}",
      InertLine(map.area()),
      map.version().value(),
      map.content_hash(),
      TimeText(map.stamp()),
      CountText(map.groups().size(), "landmark"),
      map.anonymous_landmarks().size(),
      CountText(map.vehicles().size(), "vehicle"),
      table.ToString(style));
}

Status RunShow(const StoreArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments, &store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto parent, ParentOf(map.area(), map.version(), &store));
  context.Report(context.json() ? MapJson(map, parent) : Json(),
                 context.json() ? "" : MapText(map, context.style()));
  return OkStatus();
}

Status RunVehicles(const StoreArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments, &store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VehicleTrust> trust,
                            store.Trust(map.area(), map.version()));
  context.Report({{"area", map.area()},
                  {"version", map.version().value()},
                  {"vehicles", VehiclesJson(map.vehicles())},
                  {"trust", TrustJson(trust)}},
                 VehiclesText(map.vehicles(), context.style()) + TrustText(trust));
  return OkStatus();
}

}  // namespace

void AddMapCommands(Application* application) {
  AddLandmarkCommands(application);
  auto show = std::make_shared<StoreArguments>();
  Command& show_command = application->AddCommand(
      "show", "Show a map: landmarks, modes, probabilities", [show](Context& context) {
        return RunShow(*show, context);
      });
  AddMapOptions(show.get(), &show_command);
  AddKnownOption(show.get(), &show_command);
  show_command.Watchable();

  auto vehicles = std::make_shared<StoreArguments>();
  Command& vehicles_command = application->AddCommand(
      "vehicles",
      "List what the map knows of each vehicle's odometry and sensor, with intervals",
      [vehicles](Context& context) { return RunVehicles(*vehicles, context); });
  AddMapOptions(vehicles.get(), &vehicles_command);
  vehicles_command.Watchable();
}

}  // namespace shiftmap
