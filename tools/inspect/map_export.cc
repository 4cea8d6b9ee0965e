// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/map_export.h"

#include <Eigen/LU>
#include <cmath>
#include <cstddef>
#include <nlohmann/json.hpp>

#include "mapstore/core/csv.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/map/move_rate.h"
#include "tools/inspect/vehicle_table.h"

namespace shiftmap {
namespace {

Json CovarianceJson(const Mode& mode) {
  const Eigen::Matrix2d& cov = mode.cov_p_map_landmark;
  return Json::array({cov(0, 0), cov(0, 1), cov(1, 1)});
}

Json PointJson(const Mode& mode, Json properties) {
  const Eigen::Vector2d& p = mode.p_map_landmark;
  properties["cov_m2"] = CovarianceJson(mode);
  properties["last_seen_s"] = ToSecondsSinceEpoch(mode.last_seen);
  return {{"type", "Feature"},
          {"geometry", {{"type", "Point"}, {"coordinates", Json::array({p.x(), p.y()})}}},
          {"properties", std::move(properties)}};
}

// Visits each mode with its group and probability.
template <typename Visit>
void ForEachMode(const MapSnapshot& snapshot, const Visit& visit) {
  for (const LandmarkGroup& group : snapshot.groups()) {
    for (std::size_t i = 0; i < group.modes.size(); ++i) {
      visit(group, group.modes[i], group.probabilities(static_cast<Eigen::Index>(i + 1)));
    }
  }
}

}  // namespace

Json RhythmJson(const ChainRhythm& rhythm) {
  Json phases = Json::array();
  for (const Eigen::MatrixXd& rates : rhythm.rate_matrices()) {
    Json by_rows = Json::array();
    for (const auto& row : rates.rowwise()) {
      for (const double rate : row) by_rows.push_back(rate);
    }
    phases.push_back({{"leave_rate_per_s", -rates.diagonal().mean()}, {"rate_per_s", by_rows}});
  }
  return {{"period_s", ToSeconds(rhythm.calendar().period)}, {"phases", phases}};
}

Json MapJson(const MapSnapshot& snapshot, const std::optional<VersionNumber>& parent) {
  Json groups = Json::array();
  for (const LandmarkGroup& group : snapshot.groups()) {
    Json modes = Json::array();
    modes.push_back({{"mode", kAbsent.value()}, {"probability", group.probabilities(0)}});
    for (std::size_t i = 0; i < group.modes.size(); ++i) {
      const Mode& mode = group.modes[i];
      modes.push_back({{"mode", mode.number.value()},
                       {"x_m", mode.p_map_landmark.x()},
                       {"y_m", mode.p_map_landmark.y()},
                       {"cov_m2", CovarianceJson(mode)},
                       {"probability", group.probabilities(static_cast<Eigen::Index>(i + 1))},
                       {"last_seen_s", ToSecondsSinceEpoch(mode.last_seen)}});
    }
    groups.push_back({{"signature", group.signature.text()},
                      {"leave_rate_per_s", group.chain.leave_rate_per_s()},
                      {"move_rate_per_s", MoveRate(group.chain)},
                      {"modes", modes}});
    if (const ChainRhythm* const rhythm = group.chain.rhythm()) {
      groups.back()["rhythm"] = RhythmJson(*rhythm);
    }
  }
  return {{"area", snapshot.area()},
          {"version", snapshot.version().value()},
          {"content_hash", snapshot.content_hash()},
          {"parent", parent ? Json(parent->value()) : Json(nullptr)},
          {"stamp_s", ToSecondsSinceEpoch(snapshot.stamp())},
          {"groups", groups},
          {"vehicles", VehiclesJson(snapshot.vehicles())},
          {"anonymous_landmarks", snapshot.anonymous_landmarks().size()}};
}

std::string MapGeoJson(const MapSnapshot& snapshot) {
  Json features = Json::array();
  ForEachMode(snapshot, [&](const LandmarkGroup& group, const Mode& mode, double probability) {
    features.push_back(PointJson(mode,
                                 {{"signature", group.signature.text()},
                                  {"mode", mode.number.value()},
                                  {"probability", probability},
                                  {"leave_rate_per_s", group.chain.leave_rate_per_s()}}));
  });
  for (const Mode& mode : snapshot.anonymous_landmarks()) {
    features.push_back(PointJson(mode, Json::object()));
  }
  return JsonText({{"type", "FeatureCollection"},
                   {"area", snapshot.area()},
                   {"version", snapshot.version().value()},
                   {"content_hash", snapshot.content_hash()},
                   {"stamp_s", ToSecondsSinceEpoch(snapshot.stamp())},
                   {"coordinates", "metres in the map frame"},
                   {"features", features}});
}

std::string MapCsv(const MapSnapshot& snapshot) {
  std::string text = "signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability\n";
  ForEachMode(snapshot, [&](const LandmarkGroup& group, const Mode& mode, double probability) {
    text += fmt::format("{},{},{},{},{},{},{}\n",
                        CsvText(group.signature.text()),
                        mode.number.value(),
                        mode.p_map_landmark.x(),
                        mode.p_map_landmark.y(),
                        std::sqrt(mode.cov_p_map_landmark(0, 0)),
                        std::sqrt(mode.cov_p_map_landmark(1, 1)),
                        probability);
  });
  return text;
}

std::string MapG2o(const MapSnapshot& snapshot, const Provenance& provenance) {
  std::string text = fmt::format(
      "# area {} version {}, metres and radians in the map frame\n"
      "# A version keeps no measurements: poses are fixed, landmarks have their marginal prior.\n",
      InertLine(snapshot.area()),
      snapshot.version().value());
  std::size_t id = 0;
  const auto add_landmark = [&](const Mode& mode, const std::string& comment) {
    const Eigen::Vector2d& p = mode.p_map_landmark;
    const Eigen::Matrix2d information = mode.cov_p_map_landmark.inverse();
    text += fmt::format("# {}\nVERTEX_XY {} {} {}\nEDGE_PRIOR_XY {} {} {} {} {} {}\n",
                        comment,
                        id,
                        p.x(),
                        p.y(),
                        id,
                        p.x(),
                        p.y(),
                        information(0, 0),
                        information(0, 1),
                        information(1, 1));
    ++id;
  };
  ForEachMode(snapshot, [&](const LandmarkGroup& group, const Mode& mode, double probability) {
    add_landmark(mode,
                 fmt::format("landmark '{}' mode {} probability {}",
                             InertLine(group.signature.text()),
                             mode.number.value(),
                             probability));
  });
  for (const Mode& mode : snapshot.anonymous_landmarks()) add_landmark(mode, "anonymous landmark");
  for (const RunRecord& run : provenance.runs) {
    text += fmt::format("# run '{}', {} poses\n", InertLine(run.name), run.trajectory.size());
    for (const auto& [stamp, T_map_vehicle] : run.trajectory) {
      text += fmt::format("VERTEX_SE2 {} {} {} {}\nFIX {}\n",
                          id,
                          T_map_vehicle.x(),
                          T_map_vehicle.y(),
                          T_map_vehicle.yaw(),
                          id);
      ++id;
    }
  }
  return text;
}

}  // namespace shiftmap
