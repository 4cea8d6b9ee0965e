// SPDX-License-Identifier: Apache-2.0
#include "localizer/cli/service_json.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "mapstore/core/inert_text.h"

namespace shiftmap {
namespace {

Json PoseJson(const PoseWithCovariance& pose) {
  const Se2& T = pose.T_map_vehicle;
  Json cov = Json::array();
  for (int row = 0; row < 3; ++row) {
    for (int column = row; column < 3; ++column) cov.push_back(pose.cov_T_map_vehicle(row, column));
  }
  return {{"T_map_vehicle", {T.x(), T.y(), T.yaw()}}, {"cov_T_map_vehicle", cov}};
}

Json Describe(const live::Reply& reply) {
  return {{"event", "reply"}, {"id", reply.id}, {"message", Message(reply.status)}};
}

Json Describe(const live::PoseEvent& pose) {
  Json document = {{"event", "pose"},
                   {"stamp_s", ToSecondsSinceEpoch(pose.stamp)},
                   {"state", ToString(pose.state)}};
  document.update(PoseJson(pose.pose));
  return document;
}

Json Describe(const live::StateEvent& state) {
  return {{"event", "state"},
          {"stamp_s", ToSecondsSinceEpoch(state.stamp)},
          {"state", ToString(state.state)}};
}

Json Describe(const Decision& decision) {
  return {{"event", "decision"},
          {"stamp_s", ToSecondsSinceEpoch(decision.stamp)},
          {"signature", decision.signature.text()},
          {"mode", decision.mode.value()},
          {"log_odds", decision.log_odds}};
}

Json Describe(const live::DownloadMap& download) {
  return {{"event", "map_download"},
          {"action_id", download.action_id},
          {"map_id", download.map_id},
          {"map_version", download.map_version},
          {"link", download.link}};
}

}  // namespace

Json ServiceJson(const live::ServiceState& state) {
  Json document;
  document["running"] = state.running;
  document["resumed"] = state.resumed;
  document["area"] = state.area;
  document["version"] = state.version.value();
  document["content_hash"] = state.content_hash;
  document["state"] = ToString(state.localizer_state);
  document["time_line"] = ToString(state.time_line);
  document["clock_jumps"] = state.clock_jumps;
  document["stamp_s"] = ToSecondsSinceEpoch(state.stamp);
  if (state.pose) document.update(PoseJson(*state.pose));
  document["scans"] = state.scans;
  document["decisions"] = state.decisions;
  document["overruns"] = state.overruns;
  if (state.running)
    document["calibration"] = state.calibrated_vehicle.empty() ? "fleet" : "vehicle";
  document["report_uuid"] = state.report_uuid;
  document["report"] = state.report_path;
  Json dropped = Json::object();
  for (const DroppedCount& entry : state.dropped) dropped[entry.reason] = entry.count;
  document["dropped"] = dropped;
  return document;
}

std::string ServiceText(const live::ServiceState& state) {
  // A folder of maps may have none yet.
  const std::string map = state.content_hash.empty()
                              ? std::string("no map")
                              : fmt::format("version {}", state.version.value());
  std::string text = fmt::format("area '{}' {}: {}{}\n",
                                 InertLine(state.area),
                                 map,
                                 state.running ? "running" : "stopped",
                                 state.resumed ? ", resumed" : "");
  if (state.running) {
    text += fmt::format("{}, {} scans, {} decisions, {} overruns\n",
                        ToString(state.localizer_state),
                        state.scans,
                        state.decisions,
                        state.overruns);
  }
  if (state.time_line == live::TimeLine::kLate) {
    text += "no pose: all items are older than the last one that was localized\n";
  } else if (state.time_line == live::TimeLine::kFuture) {
    text += "no pose: items are ahead of this host's clock\n";
  }
  if (state.clock_jumps > 0) {
    text += fmt::format("shifts ended by a clock that was set back: {}\n", state.clock_jumps);
  }
  if (state.pose) {
    const Se2& T = state.pose->T_map_vehicle;
    text += fmt::format("pose {:.3f} {:.3f} {:.4f}\n", T.x(), T.y(), T.yaw());
  }
  if (!state.report_path.empty()) text += fmt::format("report {}\n", InertLine(state.report_path));
  for (const DroppedCount& entry : state.dropped) {
    text += fmt::format("dropped: {} {}\n", entry.count, InertLine(entry.reason));
  }
  return text;
}

Json EventJson(const live::Event& event) {
  return std::visit([](const auto& item) { return Describe(item); }, event);
}

std::string EventText(const live::Event& event) {
  return InertLine(EventJson(event).dump()) + "\n";
}

}  // namespace shiftmap
