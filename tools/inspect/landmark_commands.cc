// SPDX-License-Identifier: Apache-2.0
//
// Commands about one landmark: why does the map say of it what it says?
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "mapstore/cli/aligned_table.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/count_text.h"
#include "mapstore/map_store.h"
#include "tools/inspect/edit_text.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/landmark_text.h"
#include "tools/inspect/map_export.h"
#include "tools/inspect/store_arguments.h"
#include "tools/plot/history_plot.h"

namespace shiftmap {
namespace {

constexpr std::int64_t kDefaultSteps = 10;
constexpr std::size_t kShownVisits = 20;  // Of `history`,
constexpr std::size_t kLastVisits = 3;    // and of `modes`.

struct ModesArguments {
  StoreArguments store;
  std::string signature;
};

struct HistoryArguments {
  StoreArguments store;
  std::string signature;
  std::optional<std::int64_t> steps;
  std::optional<std::int64_t> limit;
};

// At the time asked for, else by this host's clock, as LoadMap.
HistoryOptions OptionsOf(const StoreArguments& arguments) {
  HistoryOptions options;
  if (arguments.version) options.version = VersionNumber(*arguments.version);
  if (arguments.known_s) options.known = StampFromSeconds(*arguments.known_s);
  options.at =
      arguments.at_s ? StampFromSeconds(*arguments.at_s) : options.known.value_or(SystemNow());
  return options;
}

StatusOr<LandmarkHistory> Load(const StoreArguments& arguments,
                               const std::string& signature,
                               const HistoryOptions& options,
                               const Context& context,
                               MapStore* store) {
  StatusOr<LandmarkHistory> history =
      LoadLandmarkHistory(store, arguments.area, Signature(signature), options);
  if (!history.ok()) return NameLandmark(history.status(), arguments, signature, store, context);
  WarnOfEarlierTime(arguments, history->stamp, context);
  return history;
}

std::string VersionsText(const std::vector<VersionNumber>& versions) {
  std::string text;
  for (const VersionNumber version : versions) {
    text += fmt::format("{}{}", text.empty() ? "" : ", ", version.value());
  }
  return text;
}

Json ModeJson(const LandmarkGroup& group, std::size_t index) {
  const Mode& mode = group.modes[index];
  return {{"signature", group.signature.text()},
          {"mode", mode.number.value()},
          {"x_m", mode.p_map_landmark.x()},
          {"y_m", mode.p_map_landmark.y()},
          {"sd_x_m", std::sqrt(mode.cov_p_map_landmark(0, 0))},
          {"sd_y_m", std::sqrt(mode.cov_p_map_landmark(1, 1))},
          {"probability", group.probabilities(static_cast<Eigen::Index>(index + 1))},
          {"last_seen_s", ToSecondsSinceEpoch(mode.last_seen)}};
}

Status RunAllModes(const StoreArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, LoadMap(arguments, &store, context));
  if (context.json()) {
    Json list = Json::array();
    Json rhythms = Json::object();
    for (const LandmarkGroup& group : map.groups()) {
      for (std::size_t i = 0; i < group.modes.size(); ++i) list.push_back(ModeJson(group, i));
      if (const ChainRhythm* const rhythm = group.chain.rhythm()) {
        rhythms[group.signature.text()] = RhythmJson(*rhythm);
      }
    }
    context.Report({{"area", map.area()},
                    {"version", map.version().value()},
                    {"modes", list},
                    {"rhythms", rhythms}},
                   "");
    return OkStatus();
  }
  AlignedTable table({"signature", "mode", "x_m", "y_m", "sd_x_m", "sd_y_m", "probability"});
  for (const LandmarkGroup& group : map.groups()) {
    for (std::size_t i = 0; i < group.modes.size(); ++i) {
      const Mode& mode = group.modes[i];
      const Eigen::Vector2d sd = mode.cov_p_map_landmark.diagonal().cwiseSqrt();
      table.AddRow({group.signature.text(),
                    fmt::format("{}", mode.number.value()),
                    fmt::format("{:.3f}", mode.p_map_landmark.x()),
                    fmt::format("{:.3f}", mode.p_map_landmark.y()),
                    fmt::format("{:.3f}", sd.x()),
                    fmt::format("{:.3f}", sd.y()),
                    fmt::format("{:.4f}", group.probabilities(static_cast<Eigen::Index>(i + 1)))});
    }
  }
  context.Report({}, table.ToString(context.style()));
  return OkStatus();
}

Status RunModes(const ModesArguments& arguments, Context& context) {
  if (arguments.signature.empty()) return RunAllModes(arguments.store, context);
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  SHIFTMAP_ASSIGN_OR_RETURN(
      const LandmarkHistory history,
      Load(arguments.store, arguments.signature, OptionsOf(arguments.store), context, &store));
  if (!history.in_version) {
    return NotFound("area '{}': version {} has no landmark '{}'; only versions {}",
                    history.area,
                    history.version.value(),
                    arguments.signature,
                    VersionsText(history.versions));
  }
  Json list = Json::array();
  for (const ModeHistory& mode : history.modes) {
    if (mode.gone) continue;
    const Eigen::Matrix2d& cov = mode.position.cov_p_map_landmark;
    list.push_back({{"signature", history.signature.text()},
                    {"mode", mode.number.value()},
                    {"x_m", mode.position.p_map_landmark.x()},
                    {"y_m", mode.position.p_map_landmark.y()},
                    {"sd_x_m", std::sqrt(cov(0, 0))},
                    {"sd_y_m", std::sqrt(cov(1, 1))},
                    {"probability", mode.probability},
                    {"last_seen_s", ToSecondsSinceEpoch(mode.last_seen)}});
  }
  context.Report({{"area", history.area},
                  {"version", history.version.value()},
                  {"modes", list},
                  {"landmark", HistoryJson(history, kLastVisits)}},
                 VerdictText(history) + MoveRateText(history) + "\n" +
                     ModesText(history, context.style()) + "\n" +
                     VisitsText(history, kLastVisits, context.style()));
  return OkStatus();
}

// Whether one of the modes that the map has is where it was seen.
bool IsExplained(const UnmappedSighting& sighting, const std::vector<ModeHistory>& modes) {
  return std::any_of(modes.begin(), modes.end(), [&](const ModeHistory& mode) {
    return !mode.gone &&
           Gates(sighting, mode.position.p_map_landmark, mode.position.cov_p_map_landmark);
  });
}

// From the version's stamp to the time asked for, else to the newest end of the evidence.
StatusOr<std::vector<Stamp>> TrackTimes(const HistoryArguments& arguments,
                                        VersionNumber version,
                                        MapStore* store) {
  const std::string& area = arguments.store.area;
  std::optional<Stamp> until;
  if (arguments.store.at_s) until = StampFromSeconds(*arguments.store.at_s);
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot newest, store->LoadAt(area, version, until));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions, store->Versions(area));
  for (const VersionSummary& other : versions) {
    if (other.version != version) continue;
    return EvenTimes(other.stamp, newest.stamp(), arguments.steps.value_or(kDefaultSteps));
  }
  return std::vector<Stamp>();
}

// Where shifts saw the landmark, and the map has no mode of it.
StatusOr<std::string> UnexplainedText(const LandmarkHistory& history, MapStore* store) {
  constexpr std::size_t kShown = 3;
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<UnmappedSighting> sightings,
                            store->Sightings(history.area));
  std::erase_if(sightings, [&](const UnmappedSighting& sighting) {
    return sighting.signature != history.signature || sighting.first > history.stamp ||
           IsExplained(sighting, history.modes);
  });
  std::string text;
  for (std::size_t i = 0; i < std::min(sightings.size(), kShown); ++i) {
    const UnmappedSighting& sighting = sightings[i];
    text += fmt::format("seen where it has no mode: at ({:.2f}, {:.2f}) m, {} until {} UTC\n",
                        sighting.p_map_landmark.x(),
                        sighting.p_map_landmark.y(),
                        CountText(sighting.count, "time"),
                        TimeText(sighting.last));
  }
  return text;
}

// The edits of the landmark, under whatever name, those taken back included.
StatusOr<std::vector<MapEdit>> EditsOfLandmark(const LandmarkHistory& history, MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<MapEdit> edits, store->Edits(history.area));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> held,
                            store->EditsOf(history.area, history.version));
  const Signature landmark = LandmarkNames(held).Landmark(history.signature);
  std::erase_if(edits, [&](const MapEdit& edit) {
    return edit.kind == EditKind::kCalibration || edit.landmark != landmark;
  });
  return edits;
}

Status RunHistory(const HistoryArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  HistoryOptions options = OptionsOf(arguments.store);
  if (context.json() || arguments.steps) {
    SHIFTMAP_ASSIGN_OR_RETURN(const VersionNumber version, SelectVersion(arguments.store, &store));
    SHIFTMAP_ASSIGN_OR_RETURN(options.track, TrackTimes(arguments, version, &store));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const LandmarkHistory history,
                            Load(arguments.store, arguments.signature, options, context, &store));
  const auto limit = arguments.limit ? static_cast<std::size_t>(*arguments.limit) : kShownVisits;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string unexplained, UnexplainedText(history, &store));
  std::string text = VerdictText(history) + unexplained + "\n" +
                     ModesText(history, context.style()) + "\n" +
                     VisitsText(history, limit, context.style());
  if (arguments.steps) text += "\n" + TrackText(history, context.style());
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> edits, EditsOfLandmark(history, &store));
  Json document = HistoryJson(history, arguments.limit ? limit : 0);
  document["edits"] = Json::array();
  if (!edits.empty()) text += "\n";
  for (const MapEdit& edit : edits) {
    document["edits"].push_back(EditJson(edit));
    text += EditLine(edit);
  }
  context.Report(document, text);
  return OkStatus();
}

}  // namespace

void AddLandmarkCommands(Application* application) {
  auto modes = std::make_shared<ModesArguments>();
  Command& modes_command = application->AddCommand(
      "modes",
      "List modes with their uncertainty; of one landmark also how often it moves, what became of "
      "its modes, and the last visits",
      [modes](Context& context) { return RunModes(*modes, context); });
  AddMapOptions(&modes->store, &modes_command);
  AddKnownOption(&modes->store, &modes_command);
  modes_command.Option("SIGNATURE", &modes->signature, "Of one landmark only").Watchable();

  auto history = std::make_shared<HistoryArguments>();
  Command& history_command = application->AddCommand(
      "history",
      "Show every visit of a landmark: what it says by itself, whether it counts, and the "
      "probabilities after it",
      [history](Context& context) { return RunHistory(*history, context); });
  AddMapOptions(&history->store, &history_command);
  AddKnownOption(&history->store, &history_command);
  history_command.Option("SIGNATURE", &history->signature, "The landmark")
      .Required()
      .Option("--limit", &history->limit, "The newest so many visits; 0: all (default: text: 20)")
      .InRange(0, 1e9)
      .Option("--steps",
              &history->steps,
              "Also the probabilities at so many times since the version was built")
      .InRange(1, 10000)
      .Watchable();
}

}  // namespace shiftmap
