// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/codec/hypothesis_codec.h"

#include <utility>

namespace shiftmap::live {
namespace {

using Node = HypothesisView::Node;
using VisitView = HypothesisView::VisitView;

void Fill(const Node& node, proto::Hypotheses::Node* out) {
  out->set_parent(node.parent);
  out->set_signature(node.signature.text());
  if (node.mode) out->set_mode(node.mode->value());
  out->set_probability(node.probability);
  if (!node.T_map_vehicle) return;
  const Se2& T = *node.T_map_vehicle;
  for (const double value : {T.x(), T.y(), T.yaw()}) out->add_pose(value);
}

void Fill(const VisitView& visit, proto::Hypotheses::Visit* out) {
  out->set_signature(visit.signature.text());
  out->set_begin_ns(ToNanoseconds(visit.begin));
  out->set_observations(visit.observations);
  if (visit.decided) out->set_decided(visit.decided->value());
  for (const auto& [mode, probability] : visit.probabilities) {
    out->add_mode(mode.value());
    out->add_probability(probability);
  }
}

// @param index  Of the node.
StatusOr<Node> NodeFromProto(const proto::Hypotheses::Node& in, int index) {
  const int first = index == 0 ? -1 : 0;
  if (in.parent() < first || in.parent() >= index) {
    return InvalidArgument(
        "hypotheses: node {}: parent {}, expected {} to {}", index, in.parent(), first, index - 1);
  }
  Node node;
  node.parent = in.parent();
  node.signature = Signature(in.signature());
  if (in.has_mode()) node.mode = ModeNumber(in.mode());
  node.probability = in.probability();
  if (in.pose_size() == 3) {
    node.T_map_vehicle = Se2(in.pose(0), in.pose(1), in.pose(2));
  } else if (in.pose_size() != 0) {
    return InvalidArgument(
        "hypotheses: node {}: pose of {} numbers, expected 3", index, in.pose_size());
  }
  return node;
}

StatusOr<VisitView> VisitFromProto(const proto::Hypotheses::Visit& in) {
  if (in.mode_size() != in.probability_size()) {
    return InvalidArgument("hypotheses: visit of '{}': {} probabilities, expected {}",
                           in.signature(),
                           in.probability_size(),
                           in.mode_size());
  }
  VisitView visit;
  visit.signature = Signature(in.signature());
  visit.begin = StampFromNanoseconds(in.begin_ns());
  visit.observations = in.observations();
  if (in.has_decided()) visit.decided = ModeNumber(in.decided());
  for (int i = 0; i < in.mode_size(); ++i) {
    visit.probabilities.push_back({ModeNumber(in.mode(i)), in.probability(i)});
  }
  return visit;
}

}  // namespace

void ToProto(const HypothesisView& view, proto::Hypotheses* out) {
  out->set_leaves(view.leaves);
  out->set_probability_left_out(view.probability_left_out);
  out->set_dropped_mass_max(view.dropped_mass_max);
  out->set_global_hypothesis(view.global_hypothesis);
  for (const Node& node : view.nodes) Fill(node, out->add_nodes());
  for (const VisitView& visit : view.visits) Fill(visit, out->add_visits());
}

StatusOr<HypothesisView> HypothesesFromProto(const proto::Hypotheses& in) {
  HypothesisView view;
  view.leaves = in.leaves();
  view.probability_left_out = in.probability_left_out();
  view.dropped_mass_max = in.dropped_mass_max();
  view.global_hypothesis = in.global_hypothesis();
  for (int i = 0; i < in.nodes_size(); ++i) {
    SHIFTMAP_ASSIGN_OR_RETURN(Node node, NodeFromProto(in.nodes(i), i));
    view.nodes.push_back(std::move(node));
  }
  if (view.global_hypothesis < 0 || view.global_hypothesis >= in.nodes_size()) {
    return InvalidArgument("hypotheses: global hypothesis {}, expected a node of {}",
                           view.global_hypothesis,
                           in.nodes_size());
  }
  for (const proto::Hypotheses::Visit& entry : in.visits()) {
    SHIFTMAP_ASSIGN_OR_RETURN(VisitView visit, VisitFromProto(entry));
    view.visits.push_back(std::move(visit));
  }
  return view;
}

}  // namespace shiftmap::live
