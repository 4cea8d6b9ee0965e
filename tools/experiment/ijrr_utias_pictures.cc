// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_utias_pictures.h"

#include <algorithm>
#include <string>

namespace shiftmap {
namespace {

Chart MapOf(const UtiasCase& data, double delta_m, const char* what) {
  Chart chart;
  chart.title =
      fmt::format("Data set {}, robot {}: {} at {} m", data.dataset, data.robot, what, delta_m);
  chart.x_label = "x [m]";
  chart.y_label = "y [m]";
  chart.equal_axes = true;
  ChartSeries& truth = SeriesNamed("truth", &chart);
  truth.marker_radius = 0.0;
  const Stamp end = data.frames.frames.back().stamp;
  for (const StampedPose& pose : data.truth) {
    if (pose.stamp <= end) truth.points.push_back(pose.T_map_vehicle.translation());
  }
  return chart;
}

void AddPath(const IjrrUtiasRow& row, Chart* chart) {
  ChartSeries& path = SeriesNamed(row.method, chart);
  path.marker_radius = 0.0;
  for (const Se2& pose : row.estimate.poses) path.points.push_back(pose.translation());
}

void AddPoints(const std::string& name,
               std::vector<Eigen::Vector2d> points,
               double marker_radius,
               Chart* chart) {
  if (points.empty()) return;
  chart->series.push_back({name, std::move(points), false, marker_radius});
}

void AddLandmarks(const UtiasCase& data, double delta_m, Chart* chart) {
  std::vector<Eigen::Vector2d> surveyed;
  std::vector<Eigen::Vector2d> displaced;
  for (const auto& [signature, place] : data.landmarks) surveyed.push_back(place);
  const LandmarkPlaces map = Displaced(data.landmarks, data.moved, delta_m);
  for (const Signature& signature : data.moved) displaced.push_back(map.at(signature));
  AddPoints("landmarks", std::move(surveyed), 5.0, chart);
  AddPoints("displaced in the map", std::move(displaced), 5.0, chart);
}

const IjrrUtiasRow* RowOf(const std::vector<const IjrrUtiasRow*>& rows, const char* method) {
  const auto found = std::find_if(
      rows.begin(), rows.end(), [&](const IjrrUtiasRow* row) { return row->method == method; });
  return found == rows.end() || (*found)->estimate.poses.empty() ? nullptr : *found;
}

// The tree search over the whole run or, where that did not run, in a window.
const char* TreeSearchOf(const std::vector<const IjrrUtiasRow*>& rows) {
  return RowOf(rows, "mcts") != nullptr ? "mcts" : "mcts-40s";
}

// All but the first of each landmark, which the map has.
std::vector<Eigen::Vector2d> CreatedModes(const IjrrUtiasRow& row) {
  std::vector<Eigen::Vector2d> created;
  for (const std::vector<Eigen::Vector2d>& modes : row.estimate.modes) {
    for (std::size_t m = 1; m < modes.size(); ++m) created.push_back(modes[m]);
  }
  return created;
}

}  // namespace

Chart DrawPaths(const UtiasCase& data, const std::vector<const IjrrUtiasRow*>& rows) {
  const double delta_m = rows.front()->delta_m;
  Chart chart = MapOf(data, delta_m, "paths");
  for (const char* method : {"maxmix", TreeSearchOf(rows), "ours"}) {
    if (const IjrrUtiasRow* row = RowOf(rows, method)) AddPath(*row, &chart);
  }
  AddLandmarks(data, delta_m, &chart);
  return chart;
}

Chart DrawCreatedModes(const UtiasCase& data, const std::vector<const IjrrUtiasRow*>& rows) {
  const double delta_m = rows.front()->delta_m;
  Chart chart = MapOf(data, delta_m, "modes created");
  AddLandmarks(data, delta_m, &chart);
  // The one with the most modes first, under the others.
  for (const char* method : {"em", TreeSearchOf(rows), "ours"}) {
    const IjrrUtiasRow* row = RowOf(rows, method);
    if (row == nullptr) continue;
    AddPath(*row, &chart);
    AddPoints(fmt::format("modes of {}", method), CreatedModes(*row), 4.0, &chart);
  }
  return chart;
}

}  // namespace shiftmap
