// SPDX-License-Identifier: Apache-2.0
#include "localizer/cli/vda5050_json.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "mapstore/core/inert_text.h"

namespace shiftmap {
namespace {

Json PositionJson(const live::FleetState& state) {
  // A robot that can localize itself always reports a position, and whether it is one.
  const Se2 T = state.T_map_vehicle.value_or(Se2());
  Json position = {{"x", T.x()},
                   {"y", T.y()},
                   {"theta", T.yaw()},
                   {"mapId", state.map_id},
                   {"localized", state.localized},
                   {"localizationScore", state.localization_score}};
  if (state.deviation_range_m) position["deviationRange"] = *state.deviation_range_m;
  return position;
}

Json ErrorJson(const live::FleetError& error) {
  Json references = Json::array();
  for (const auto& [key, value] : error.references) {
    references.push_back({{"referenceKey", key}, {"referenceValue", value}});
  }
  return {{"errorType", error.type},
          {"errorLevel", error.level},
          {"errorDescription", error.description},
          {"errorReferences", references}};
}

}  // namespace

Json Vda5050Json(const live::FleetState& state) {
  Json maps = Json::array();
  for (const live::FleetState::Map& map : state.maps) {
    maps.push_back({{"mapId", map.map_id},
                    {"mapVersion", map.map_version},
                    {"mapStatus", map.enabled ? "ENABLED" : "DISABLED"}});
  }
  Json errors = Json::array();
  for (const live::FleetError& error : state.errors) errors.push_back(ErrorJson(error));
  Json actions = Json::array();
  for (const live::ActionState& action : state.actions) {
    actions.push_back({{"actionId", action.action_id},
                       {"actionType", action.type},
                       {"actionStatus", live::ToString(action.status)},
                       {"actionResult", action.result}});
  }
  return {{"maps", maps},
          {"mobileRobotPosition", PositionJson(state)},
          {"errors", errors},
          {"instantActionStates", actions}};
}

std::string Vda5050Text(const live::FleetState& state) {
  std::string text;
  for (const live::FleetState::Map& map : state.maps) {
    text += fmt::format("map '{}' {} {}\n",
                        InertLine(map.map_id),
                        InertLine(map.map_version),
                        map.enabled ? "ENABLED" : "DISABLED");
  }
  if (state.localized) {
    const Se2& T = *state.T_map_vehicle;
    text += fmt::format("at {:.3f} {:.3f} {:.4f} on '{}', score {:.2f}, within {:.3f} m\n",
                        T.x(),
                        T.y(),
                        T.yaw(),
                        InertLine(state.map_id),
                        state.localization_score,
                        state.deviation_range_m.value_or(0.0));
  } else {
    text += "not localized\n";
  }
  for (const live::FleetError& error : state.errors) {
    text += fmt::format("{} {}: {}\n", error.level, error.type, InertLine(error.description));
  }
  for (const live::ActionState& action : state.actions) {
    text += fmt::format("{} '{}' {}{}{}\n",
                        action.type,
                        InertLine(action.action_id),
                        live::ToString(action.status),
                        action.result.empty() ? "" : ": ",
                        InertLine(action.result));
  }
  return text;
}

}  // namespace shiftmap
