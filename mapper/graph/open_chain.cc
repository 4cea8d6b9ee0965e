// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/open_chain.h"

namespace shiftmap {

OpenChain::OpenChain(const Graph& graph) {
  IndexedVector<ModeIndex, std::vector<Sight>> sights(graph.modes.size());
  for (const GraphObservation& item : graph.observations) {
    sights[item.mode].push_back({item.run, item.frame});
  }
  for (const std::vector<Sight>& of_mode : sights) {
    sights_.push_back(of_mode.empty() ? Sight() : of_mode[of_mode.size() / 2]);
  }
}

void OpenChain::Apply(const GraphStep& step, Graph* graph) const {
  const auto pose_step = [&](RunIndex run, FrameIndex frame) {
    return step.poses[run].segment<3>(3 * frame);
  };
  // Modes as their poses see them, before these move.
  IndexedVector<ModeIndex, Eigen::Vector2d> seen;
  for (const ModeIndex m : sights_.indices()) {
    const auto [run, frame] = sights_[m];
    const Se2& T_map_vehicle = graph->runs[run].poses[frame];
    const Eigen::Vector2d q = T_map_vehicle.Inverse() * graph->modes[m];
    const Eigen::Vector3d xi = pose_step(run, frame);
    seen.emplace_back(q + T_map_vehicle.Rotation().transpose() * step.modes.segment<2>(2 * m) -
                      xi.head<2>() - xi.z() * Eigen::Vector2d(-q.y(), q.x()));
  }
  for (const RunIndex r : graph->runs.indices()) {
    GraphRun& run = graph->runs[r];
    Se2 before = run.poses.front();
    run.poses.front() = before * Se2::Exp(pose_step(r, 0));
    for (FrameIndex i = 1; i < run.poses.end_index(); ++i) {
      const Se2 motion = before.Inverse() * run.poses[i];
      const Eigen::Vector3d change =
          pose_step(r, i) - motion.InverseAdjoint() * pose_step(r, i - 1);
      before = run.poses[i];
      run.poses[i] = run.poses[i - 1] * motion * Se2::Exp(change);
    }
    run.correction += step.calibrations[r].head<3>();
    run.sensor_bias += step.calibrations[r].tail<3>();
  }
  for (const ModeIndex m : sights_.indices()) {
    graph->modes[m] = graph->runs[sights_[m].run].poses[sights_[m].frame] * seen[m];
  }
}

}  // namespace shiftmap
