// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/open_chain.h"

#include <cstddef>

namespace shiftmap {

OpenChain::OpenChain(const Graph& graph) {
  std::vector<std::vector<Sight>> sights(graph.modes.size());
  for (const GraphObservation& item : graph.observations) {
    sights[static_cast<std::size_t>(item.mode)].push_back({item.run, item.frame});
  }
  for (const std::vector<Sight>& of_mode : sights) {
    sights_.push_back(of_mode.empty() ? Sight() : of_mode[of_mode.size() / 2]);
  }
}

void OpenChain::Apply(const GraphStep& step, Graph* graph) const {
  const auto pose_step = [&](std::size_t run, std::size_t frame) {
    return step.poses[run].segment<3>(static_cast<Eigen::Index>(3 * frame));
  };
  // Modes as their poses see them, before these move.
  std::vector<Eigen::Vector2d> seen;
  for (std::size_t m = 0; m < sights_.size(); ++m) {
    const auto run = static_cast<std::size_t>(sights_[m].run);
    const auto frame = static_cast<std::size_t>(sights_[m].frame);
    const Se2& T_map_vehicle = graph->runs[run].poses[frame];
    const Eigen::Vector2d q = T_map_vehicle.Inverse() * graph->modes[m];
    const Eigen::Vector3d xi = pose_step(run, frame);
    seen.emplace_back(q +
                      T_map_vehicle.Rotation().transpose() *
                          step.modes.segment<2>(static_cast<Eigen::Index>(2 * m)) -
                      xi.head<2>() - xi.z() * Eigen::Vector2d(-q.y(), q.x()));
  }
  for (std::size_t r = 0; r < graph->runs.size(); ++r) {
    GraphRun& run = graph->runs[r];
    Se2 before = run.poses.front();
    run.poses.front() = before * Se2::Exp(pose_step(r, 0));
    for (std::size_t i = 1; i < run.poses.size(); ++i) {
      const Se2 motion = before.Inverse() * run.poses[i];
      const Eigen::Vector3d change =
          pose_step(r, i) - motion.InverseAdjoint() * pose_step(r, i - 1);
      before = run.poses[i];
      run.poses[i] = run.poses[i - 1] * motion * Se2::Exp(change);
    }
    run.correction += step.calibrations[r].head<3>();
    run.sensor_bias += step.calibrations[r].tail<3>();
  }
  for (std::size_t m = 0; m < sights_.size(); ++m) {
    graph->modes[m] = graph->runs[static_cast<std::size_t>(sights_[m].run)]
                          .poses[static_cast<std::size_t>(sights_[m].frame)] *
                      seen[m];
  }
}

}  // namespace shiftmap
