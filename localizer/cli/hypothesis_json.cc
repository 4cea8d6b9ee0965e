// SPDX-License-Identifier: Apache-2.0
#include "localizer/cli/hypothesis_json.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

namespace shiftmap {
namespace {

using Node = HypothesisView::Node;
using VisitView = HypothesisView::VisitView;

Json ModeJson(const std::optional<ModeNumber>& mode) {
  return mode ? Json(mode->value()) : Json(nullptr);
}

Json NodeJson(const HypothesisView& view, int index) {
  const Node& node = view.nodes[static_cast<std::size_t>(index)];
  Json document;
  if (node.parent >= 0) {
    document["signature"] = node.signature.text();
    document["mode"] = ModeJson(node.mode);
  }
  document["probability"] = node.probability;
  if (node.T_map_vehicle) {
    const Se2& T = *node.T_map_vehicle;
    document["T_map_vehicle"] = {T.x(), T.y(), T.yaw()};
    document["global"] = index == view.global_hypothesis;
  }
  Json children = Json::array();
  for (int i = index + 1; i < static_cast<int>(view.nodes.size()); ++i) {
    if (view.nodes[static_cast<std::size_t>(i)].parent == index) {
      children.push_back(NodeJson(view, i));
    }
  }
  if (!children.empty()) document["children"] = children;
  return document;
}

Json VisitJson(const VisitView& visit) {
  Json probabilities = Json::object();
  for (const auto& [mode, probability] : visit.probabilities) {
    probabilities[std::to_string(mode.value())] = probability;
  }
  return {{"signature", visit.signature.text()},
          {"begin_s", ToSecondsSinceEpoch(visit.begin)},
          {"observations", visit.observations},
          {"decided", ModeJson(visit.decided)},
          {"probabilities", probabilities}};
}

std::string NodeText(const HypothesisView& view, int index, int level) {
  const Node& node = view.nodes[static_cast<std::size_t>(index)];
  const std::string mode = node.mode ? fmt::format("{}", node.mode->value()) : "several";
  std::string text =
      fmt::format("{:{}}{:.4f} {}",
                  "",
                  2 * level,
                  node.probability,
                  node.parent < 0 ? "all" : fmt::format("{}={}", node.signature.text(), mode));
  if (node.T_map_vehicle) {
    const Se2& T = *node.T_map_vehicle;
    text += fmt::format("  pose {:.3f} {:.3f} {:.4f}", T.x(), T.y(), T.yaw());
    if (index == view.global_hypothesis) text += "  global hypothesis";
  }
  text += "\n";
  for (int i = index + 1; i < static_cast<int>(view.nodes.size()); ++i) {
    if (view.nodes[static_cast<std::size_t>(i)].parent == index) {
      text += NodeText(view, i, level + 1);
    }
  }
  return text;
}

}  // namespace

Json HypothesisJson(const HypothesisView& view) {
  Json visits = Json::array();
  for (const VisitView& visit : view.visits) visits.push_back(VisitJson(visit));
  return {{"leaves", view.leaves},
          {"probability_left_out", view.probability_left_out},
          {"dropped_mass_max", view.dropped_mass_max},
          {"tree", NodeJson(view, 0)},
          {"visits", visits}};
}

std::string HypothesisText(const HypothesisView& view) {
  std::string text = fmt::format("{} leaves\n", view.leaves) + NodeText(view, 0, 0);
  for (const VisitView& visit : view.visits) {
    text += fmt::format("{}: seen {} times{}, probabilities",
                        visit.signature.text(),
                        visit.observations,
                        visit.decided ? fmt::format(", decided {}", visit.decided->value()) : "");
    for (const auto& [mode, probability] : visit.probabilities) {
      text += fmt::format(" {}:{:.4f}", mode.value(), probability);
    }
    text += "\n";
  }
  return text;
}

}  // namespace shiftmap
