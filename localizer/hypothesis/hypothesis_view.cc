// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/hypothesis_view.h"

#include <algorithm>
#include <cmath>

#include "localizer/hypothesis/tree_view.h"

namespace shiftmap {
namespace {

const LandmarkGroup& GroupOf(const MapSnapshot& snapshot, int group) {
  return snapshot.groups()[static_cast<std::size_t>(group)];
}

void AddTree(const LeafSet<Leaf>& leaves, const MapSnapshot& snapshot, HypothesisView* view) {
  const TreeView tree(leaves, HypothesisView::kMaxLeaves);
  view->nodes.resize(tree.nodes().size());
  for (std::size_t i = 0; i < tree.nodes().size(); ++i) {
    const TreeView::Node& from = tree.nodes()[i];
    HypothesisView::Node& node = view->nodes[i];
    node.probability = std::exp(from.log_probability);
    for (const std::size_t child : from.children) {
      view->nodes[child].parent = static_cast<int>(i);
    }
    if (from.leaf >= 0) {
      node.T_map_vehicle = leaves[static_cast<std::size_t>(from.leaf)].filter.T_map_vehicle();
      if (from.leaf == tree.GlobalHypothesis()) view->global_hypothesis = static_cast<int>(i);
    }
    if (from.group < 0) continue;
    const LandmarkGroup& landmark = GroupOf(snapshot, from.group);
    node.signature = landmark.signature;
    if (from.state != GroupBelief::kUnresolved) node.mode = landmark.NumberOf(from.state);
  }
}

HypothesisView::VisitView ViewVisit(const Visit& visit,
                                    const LandmarkGroup& landmark,
                                    const Eigen::VectorXd& probabilities) {
  HypothesisView::VisitView view;
  view.signature = landmark.signature;
  view.begin = visit.begin;
  view.observations = visit.observations;
  if (visit.decided) view.decided = landmark.NumberOf(*visit.decided);
  for (int state = 0; state < probabilities.size(); ++state) {
    view.probabilities.push_back({landmark.NumberOf(state), probabilities[state]});
  }
  return view;
}

}  // namespace

HypothesisView ViewHypotheses(const HypothesisBank& bank, const MapSnapshot& snapshot) {
  HypothesisView view;
  view.leaves = static_cast<std::int64_t>(bank.leaves().size());
  view.dropped_mass_max = bank.dropped_mass_max();
  AddTree(bank.leaves(), snapshot, &view);
  view.probability_left_out = std::max(0.0, 1.0 - view.nodes.front().probability);
  for (const Visit& visit : bank.visits()) {
    view.visits.push_back(
        ViewVisit(visit, GroupOf(snapshot, visit.group), bank.Probabilities(visit.group)));
  }
  return view;
}

}  // namespace shiftmap
