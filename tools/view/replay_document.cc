// SPDX-License-Identifier: Apache-2.0
#include "tools/view/replay_document.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <vector>

#include "localizer/recording/shift_recording.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr std::size_t kMaxSteps = 20'000;  // Poses of a longer shift are thinned.
constexpr std::size_t kMaxHypotheses = 5;  // The heaviest of each sample.

void Move(const Se2& T_new_old, ShiftRecording* recording) {
  for (live::PoseEvent& pose : recording->poses) {
    pose.pose.T_map_vehicle = T_new_old * pose.pose.T_map_vehicle;
  }
  for (HypothesesSample& sample : recording->hypotheses) {
    for (HypothesisView::Node& node : sample.view.nodes) {
      if (node.T_map_vehicle) node.T_map_vehicle = T_new_old * *node.T_map_vehicle;
    }
  }
}

// The columns of a step, as page/data.ts names them.
Json StepsJson(const ShiftRecording& recording, Stamp origin, std::size_t stride) {
  Json json = Json::array();
  auto scan = recording.innovations.begin();
  for (std::size_t i = 0; i < recording.poses.size(); i += stride) {
    const live::PoseEvent& pose = recording.poses[i];
    NisSum nis;
    for (; scan != recording.innovations.end() && scan->stamp <= pose.stamp; ++scan) {
      const NisSum of_scan = GatedNis(*scan);
      nis.sum += of_scan.sum;
      nis.updates += of_scan.updates;
    }
    const Se2& T_map_vehicle = pose.pose.T_map_vehicle;
    // The covariance is in the vehicle frame.
    const SigmaEllipse ellipse =
        MakeSigmaEllipse(pose.pose.cov_T_map_vehicle.topLeftCorner<2, 2>());
    json.insert(json.end(),
                {Milliseconds(pose.stamp, origin),
                 static_cast<int>(pose.state),
                 Scaled(T_map_vehicle.x(), kMillimetre),
                 Scaled(T_map_vehicle.y(), kMillimetre),
                 Scaled(T_map_vehicle.yaw(), 1e-3),
                 Scaled(ellipse.major_m, kMillimetre),
                 Scaled(ellipse.minor_m, kMillimetre),
                 Scaled(ellipse.rotation_rad + T_map_vehicle.yaw(), 1e-3),
                 Tenths(nis.sum),
                 nis.updates});
  }
  return json;
}

Json HypothesesJson(const ShiftRecording& recording, Stamp origin) {
  Json json = Json::array();
  for (const HypothesesSample& sample : recording.hypotheses) {
    std::vector<HypothesisView::Node> leaves;
    for (const HypothesisView::Node& node : sample.view.nodes) {
      if (node.T_map_vehicle) leaves.push_back(node);
    }
    std::stable_sort(leaves.begin(), leaves.end(), [](const auto& a, const auto& b) {
      return a.probability > b.probability;
    });
    leaves.resize(std::min(leaves.size(), kMaxHypotheses));
    Json row = {Milliseconds(sample.stamp, origin), sample.view.leaves};
    for (const HypothesisView::Node& leaf : leaves) {
      row.insert(row.end(),
                 {Scaled(leaf.probability, 1e-3),
                  Scaled(leaf.T_map_vehicle->x(), kMillimetre),
                  Scaled(leaf.T_map_vehicle->y(), kMillimetre),
                  Scaled(leaf.T_map_vehicle->yaw(), 1e-3)});
    }
    json.push_back(std::move(row));
  }
  return json;
}

Json StatesJson(const ShiftRecording& recording, Stamp origin) {
  Json json = Json::array();
  for (const StateChange& change : recording.states) {
    json.push_back({Milliseconds(change.stamp, origin), static_cast<int>(change.to)});
  }
  return json;
}

Json DecisionsJson(const ShiftRecording& recording,
                   Stamp origin,
                   const std::map<Signature, Signature>& aliases,
                   TextTable* signatures) {
  Json json = Json::array();
  for (const DecisionChange& change : recording.decisions) {
    const auto alias = aliases.find(change.decision.signature);
    const Signature& name = alias == aliases.end() ? change.decision.signature : alias->second;
    json.push_back({Milliseconds(change.stamp, origin),
                    signatures->Add(name.text()),
                    change.decision.mode.value(),
                    Tenths(change.decision.log_odds),
                    change.withdrawn ? 1 : 0});
  }
  return json;
}

}  // namespace

StatusOr<Json> ReplayJson(const std::string& path,
                          const std::string& area,
                          const ReplayOptions& options,
                          TextTable* signatures) {
  SHIFTMAP_ASSIGN_OR_RETURN(ShiftRecording recording, ReadShiftRecording(path));
  const RecordedShift& shift = recording.shift;
  if (shift.area != area) {
    return InvalidArgument("recording '{}': area '{}', expected '{}'", path, shift.area, area);
  }
  if (recording.poses.empty()) {
    return InvalidArgument("recording '{}': the shift has no pose, nothing to replay", path);
  }
  const auto frame = options.frames.find(shift.version);
  if (frame != options.frames.end()) Move(frame->second, &recording);
  Stamp origin = recording.poses.front().stamp;
  if (!recording.states.empty()) origin = std::min(origin, recording.states.front().stamp);
  const std::size_t stride = (recording.poses.size() + kMaxSteps - 1) / kMaxSteps;
  return Json{{"vehicle", InertLine(shift.vehicle)},
              {"run", InertLine(shift.run_uuid)},
              {"version", shift.version.value()},
              {"truncation", InertLine(recording.truncation)},
              {"origin_s", ToSecondsSinceEpoch(origin)},
              {"steps", StepsJson(recording, origin, stride)},
              {"hypotheses", HypothesesJson(recording, origin)},
              {"states", StatesJson(recording, origin)},
              {"decisions", DecisionsJson(recording, origin, options.aliases, signatures)}};
}

}  // namespace shiftmap
