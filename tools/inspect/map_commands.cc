// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "mapstore/cli/aligned_table.h"
#include "mapstore/core/inert_text.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/map_export.h"
#include "tools/inspect/store_arguments.h"
#include "tools/inspect/vehicle_table.h"

namespace shiftmap {
namespace {

// Beyond this, seconds do not fit into a Duration.
constexpr double kMaxSpanS = 9.2e9;

struct ModesArguments {
  StoreArguments store;
  std::string signature;
};

struct HistoryArguments {
  StoreArguments store;
  std::string signature;
  int steps = 10;
};

StatusOr<std::optional<VersionNumber>> ParentOf(const MapSnapshot& map, MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto versions, store->Versions(map.area()));
  for (const VersionSummary& version : versions) {
    if (version.version == map.version()) return version.parent;
  }
  return std::optional<VersionNumber>();
}

std::string ProbabilityText(double probability) { return fmt::format("{:.4f}", probability); }

std::string MapText(const MapSnapshot& map) {
  AlignedTable table({"signature", "mode", "x_m", "y_m", "probability", "now", "last_seen"});
  for (const LandmarkGroup& group : map.groups()) {
    Eigen::Index best = 0;
    group.probabilities.maxCoeff(&best);
    table.AddRow({group.signature.text(),
                  "0",
                  "-",
                  "-",
                  ProbabilityText(group.probabilities(0)),
                  best == 0 ? "*" : "",
                  "-"});
    for (std::size_t i = 0; i < group.modes.size(); ++i) {
      const Mode& mode = group.modes[i];
      const auto state = static_cast<Eigen::Index>(i + 1);
      table.AddRow({group.signature.text(),
                    fmt::format("{}", mode.number.value()),
                    fmt::format("{:.3f}", mode.p_map_landmark.x()),
                    fmt::format("{:.3f}", mode.p_map_landmark.y()),
                    ProbabilityText(group.probabilities(state)),
                    best == state ? "*" : "",
                    TimeText(mode.last_seen)});
    }
  }
  return fmt::format(
      "area {}, version {}, content {}\nprobabilities at {} UTC; {} landmarks, {} "
      "anonymous, {} vehicles\n\n{}",
      InertLine(map.area()),
      map.version().value(),
      map.content_hash(),
      TimeText(map.stamp()),
      map.groups().size(),
      map.anonymous_landmarks().size(),
      map.vehicles().size(),
      table.ToString());
}

Status RunShow(const StoreArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments, &store));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto parent, ParentOf(map, &store));
  context.Report(MapJson(map, parent), MapText(map));
  return OkStatus();
}

Status UnknownSignature(const MapSnapshot& map, const std::string& signature) {
  return NotFound(
      "area '{}': version {} has no landmark '{}'", map.area(), map.version().value(), signature);
}

Status RunModes(const ModesArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments.store, &store));
  if (!arguments.signature.empty() && map.GroupIndex(Signature(arguments.signature)) < 0) {
    return UnknownSignature(map, arguments.signature);
  }
  Json list = Json::array();
  AlignedTable table({"signature", "mode", "x_m", "y_m", "sd_x_m", "sd_y_m", "probability"});
  for (const LandmarkGroup& group : map.groups()) {
    if (!arguments.signature.empty() && group.signature.text() != arguments.signature) continue;
    for (std::size_t i = 0; i < group.modes.size(); ++i) {
      const Mode& mode = group.modes[i];
      const double probability = group.probabilities(static_cast<Eigen::Index>(i + 1));
      const Eigen::Vector2d sd = mode.cov_p_map_landmark.diagonal().cwiseSqrt();
      list.push_back({{"signature", group.signature.text()},
                      {"mode", mode.number.value()},
                      {"x_m", mode.p_map_landmark.x()},
                      {"y_m", mode.p_map_landmark.y()},
                      {"sd_x_m", sd.x()},
                      {"sd_y_m", sd.y()},
                      {"probability", probability},
                      {"last_seen_s", ToSecondsSinceEpoch(mode.last_seen)}});
      table.AddRow({group.signature.text(),
                    fmt::format("{}", mode.number.value()),
                    fmt::format("{:.3f}", mode.p_map_landmark.x()),
                    fmt::format("{:.3f}", mode.p_map_landmark.y()),
                    fmt::format("{:.3f}", sd.x()),
                    fmt::format("{:.3f}", sd.y()),
                    ProbabilityText(probability)});
    }
  }
  context.Report({{"area", map.area()}, {"version", map.version().value()}, {"modes", list}},
                 table.ToString());
  return OkStatus();
}

Status RunHistory(const HistoryArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionNumber version, SelectVersion(arguments.store, &store));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot built,
                            store.LoadVersion(arguments.store.area, version));
  std::optional<Stamp> until;
  if (arguments.store.at_s) until = StampFromSeconds(*arguments.store.at_s);
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot newest,
                            store.LoadAt(arguments.store.area, version, until));
  const int index = built.GroupIndex(Signature(arguments.signature));
  if (index < 0) return UnknownSignature(built, arguments.signature);
  const LandmarkGroup& landmark = built.groups()[static_cast<std::size_t>(index)];
  std::vector<std::string> header = {"time"};
  for (int state = 0; state < landmark.chain.states(); ++state) {
    header.push_back(fmt::format("mode {}", landmark.NumberOf(state).value()));
  }
  AlignedTable table(header);
  Json history = Json::array();
  // In seconds: what a damaged store says may be further apart than nanoseconds count.
  const double span_s = ToSecondsSinceEpoch(newest.stamp()) - ToSecondsSinceEpoch(built.stamp());
  const int steps = span_s > 0.0 && span_s < kMaxSpanS ? arguments.steps : 0;
  for (int step = 0; step <= steps; ++step) {
    const Stamp at =
        built.stamp() + (steps == 0 ? Duration(0) : FromSeconds(span_s / steps * step));
    SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map,
                              store.LoadAt(arguments.store.area, version, at));
    const LandmarkGroup& group = map.groups()[static_cast<std::size_t>(index)];
    Json probabilities = Json::object();
    std::vector<std::string> row = {TimeText(at)};
    for (Eigen::Index state = 0; state < group.probabilities.size(); ++state) {
      const std::int64_t number = group.NumberOf(static_cast<int>(state)).value();
      probabilities[fmt::format("{}", number)] = group.probabilities(state);
      row.push_back(ProbabilityText(group.probabilities(state)));
    }
    history.push_back({{"stamp_s", ToSecondsSinceEpoch(at)}, {"probabilities", probabilities}});
    table.AddRow(row);
  }
  context.Report({{"area", built.area()},
                  {"version", version.value()},
                  {"signature", arguments.signature},
                  {"history", history}},
                 table.ToString());
  return OkStatus();
}

Status RunVehicles(const StoreArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments, &store));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VehicleTrust> trust,
                            store.Trust(map.area(), map.version()));
  context.Report({{"area", map.area()},
                  {"version", map.version().value()},
                  {"vehicles", VehiclesJson(map.vehicles())},
                  {"trust", TrustJson(trust)}},
                 VehiclesText(map.vehicles()) + TrustText(trust));
  return OkStatus();
}

}  // namespace

void AddMapCommands(Application* application) {
  auto show = std::make_shared<StoreArguments>();
  Command& show_command = application->AddCommand(
      "show", "Show a map: landmarks, modes, probabilities", [show](Context& context) {
        return RunShow(*show, context);
      });
  AddMapOptions(show.get(), &show_command);
  AddKnownOption(show.get(), &show_command);

  auto modes = std::make_shared<ModesArguments>();
  Command& modes_command = application->AddCommand(
      "modes", "List modes with their uncertainty", [modes](Context& context) {
        return RunModes(*modes, context);
      });
  AddMapOptions(&modes->store, &modes_command);
  AddKnownOption(&modes->store, &modes_command);
  modes_command.Option("SIGNATURE", &modes->signature, "Of one landmark only");

  auto history = std::make_shared<HistoryArguments>();
  Command& history_command = application->AddCommand(
      "history",
      "Show how the probabilities of a landmark's modes went, from the map to the newest evidence",
      [history](Context& context) { return RunHistory(*history, context); });
  AddMapOptions(&history->store, &history_command);
  history_command.Option("SIGNATURE", &history->signature, "The landmark").Required();
  history_command.Option("--steps", &history->steps, "Number of time steps").InRange(1, 10000);

  auto vehicles = std::make_shared<StoreArguments>();
  AddMapOptions(vehicles.get(),
                &application->AddCommand(
                    "vehicles",
                    "List what the map knows of each vehicle's odometry and sensor, with intervals",
                    [vehicles](Context& context) { return RunVehicles(*vehicles, context); }));
}

}  // namespace shiftmap
