// SPDX-License-Identifier: Apache-2.0
#include "tools/eval/eval_commands.h"

#include <memory>
#include <nlohmann/json.hpp>

#include "mapstore/cli/aligned_table.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/map_store.h"
#include "tools/eval/map_error.h"
#include "tools/eval/trajectory_error.h"

namespace shiftmap {
namespace {

struct TrajectoryArguments {
  std::string estimate;
  std::string truth;
  TrajectoryErrorOptions options;
};

struct MapArguments {
  std::string store;
  std::string area;
  std::string truth;
  std::optional<std::int64_t> version;
  bool no_align = false;
};

Json PoseJson(const Se2& pose) { return Json::array({pose.x(), pose.y(), pose.yaw()}); }

Status RunTrajectory(const TrajectoryArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto estimate, ReadTum(arguments.estimate));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto truth, ReadTum(arguments.truth));
  const StatusOr<TrajectoryError> evaluated =
      EvaluateTrajectory(estimate, truth, arguments.options);
  SHIFTMAP_RETURN_IF_ERROR(Annotate(evaluated.status(), "trajectory '{}'", arguments.estimate));
  const TrajectoryError& error = *evaluated;
  const Json document = {{"matched", error.matched},
                         {"unmatched", error.unmatched},
                         {"aligned", arguments.options.align},
                         {"position_rmse_m", error.position_rmse_m},
                         {"position_mean_m", error.position_mean_m},
                         {"position_median_m", error.position_median_m},
                         {"position_p95_m", error.position_p95_m},
                         {"position_max_m", error.position_max_m},
                         {"yaw_rmse_rad", error.yaw_rmse_rad},
                         {"T_truth_estimate", PoseJson(error.T_truth_estimate)}};
  context.Report(document,
                 fmt::format("poses      {} matched, {} not\n"
                             "position   rmse {:.3f} m, mean {:.3f}, median {:.3f}, p95 {:.3f}, "
                             "max {:.3f}\n"
                             "yaw        rmse {:.4f} rad\n",
                             error.matched,
                             error.unmatched,
                             error.position_rmse_m,
                             error.position_mean_m,
                             error.position_median_m,
                             error.position_p95_m,
                             error.position_max_m,
                             error.yaw_rmse_rad));
  return OkStatus();
}

Status RunMap(const MapArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto truth, ReadTruePlaces(arguments.truth));
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(arguments.store, MapStore::Access::kReadOnly, context));
  std::optional<VersionNumber> version;
  if (arguments.version) version = VersionNumber(*arguments.version);
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, store.LoadAt(arguments.area, version));
  const StatusOr<MapError> evaluated = EvaluateMap(map.groups(), truth, !arguments.no_align);
  SHIFTMAP_RETURN_IF_ERROR(Annotate(evaluated.status(), "truth '{}'", arguments.truth));
  const MapError& error = *evaluated;
  Json places = Json::array();
  AlignedTable table({"signature", "mode", "distance_m"});
  for (const PlaceMatch& match : error.matches) {
    places.push_back({{"signature", match.signature.text()},
                      {"mode", match.mode.value()},
                      {"distance_m", match.distance_m}});
    table.AddRow({match.signature.text(),
                  fmt::format("{}", match.mode.value()),
                  fmt::format("{:.3f}", match.distance_m)});
  }
  Json unmatched = Json::array();
  for (const Signature& signature : error.unmatched) unmatched.push_back(signature.text());
  const Json document = {{"area", map.area()},
                         {"version", map.version().value()},
                         {"matched", error.matches.size()},
                         {"unmatched", unmatched},
                         {"aligned", !arguments.no_align},
                         {"rmse_m", error.rmse_m},
                         {"median_m", error.median_m},
                         {"max_m", error.max_m},
                         {"T_truth_map", PoseJson(error.T_truth_map)},
                         {"places", places}};
  context.Report(document,
                 table.ToString() + fmt::format("places {} matched, {} not: rmse {:.3f} m, median "
                                                "{:.3f}, max {:.3f}\n",
                                                error.matches.size(),
                                                error.unmatched.size(),
                                                error.rmse_m,
                                                error.median_m,
                                                error.max_m));
  return OkStatus();
}

void AddTrajectoryCommand(Application* application) {
  auto arguments = std::make_shared<TrajectoryArguments>();
  application
      ->AddCommand("trajectory",
                   "Compare a trajectory with the truth",
                   [arguments](Context& context) { return RunTrajectory(*arguments, context); })
      .Option("EST.tum", &arguments->estimate, "Estimated trajectory")
      .Required()
      .Option("TRUTH.tum", &arguments->truth, "True trajectory")
      .Required()
      .Flag("--align", &arguments->options.align, "Move the estimate onto the truth first")
      .Option("--max-gap-s", &arguments->options.max_gap_s, "Longest gap of the truth to bridge");
}

void AddMapCommand(Application* application) {
  auto arguments = std::make_shared<MapArguments>();
  application
      ->AddCommand("map",
                   "Compare the modes of a map with true places",
                   [arguments](Context& context) { return RunMap(*arguments, context); })
      .Option("TRUTH.csv", &arguments->truth, "Columns signature, x_m and y_m")
      .Required()
      .Option("--store", &arguments->store, "Map store")
      .Required()
      .Option("--area", &arguments->area, "Area")
      .Required()
      .Option("--version", &arguments->version, "Map version (default: the published one)")
      .Flag("--no-align", &arguments->no_align, "The map is in the frame of the truth already");
}

}  // namespace

void AddEvalCommands(Application* application) {
  AddTrajectoryCommand(application);
  AddMapCommand(application);
}

}  // namespace shiftmap
