// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/build_provenance.h"

#include <nlohmann/json.hpp>

#include "mapper/cli/build_report.h"
#include "mapstore/cli/version.h"

namespace shiftmap {
namespace {

// Poses of a run that the store keeps for pictures.
constexpr std::size_t kStoredPoses = 2000;

std::vector<StampedPose> Thinned(const std::vector<StampedPose>& trajectory) {
  const std::size_t step = trajectory.size() / kStoredPoses + 1;
  std::vector<StampedPose> thinned;
  for (std::size_t i = 0; i < trajectory.size(); i += step) thinned.push_back(trajectory[i]);
  return thinned;
}

// What became of the runs, for whoever looks at the version later.
Json OutcomeJson(const MapperResult& result,
                 const std::vector<std::string>& at_two_places,
                 const std::map<std::string, std::int64_t>& in_logs) {
  double chi2 = 0.0;
  std::int64_t observations = 0;
  std::int64_t outliers = 0;
  for (const MappedRun& run : result.runs) {
    chi2 += run.chi2;
    observations += run.observations;
    outliers += run.outliers;
  }
  return {{"chi2", chi2},
          {"observations", observations},
          {"outliers", outliers},
          {"modes_created", result.modes_created},
          {"modes_merged", result.modes_merged},
          {"left_out", LeftOutLines(result)},
          {"waiting", WaitingLines(result)},
          {"at_two_places", at_two_places},
          {"observations_of_logs", in_logs}};
}

}  // namespace

Provenance MakeProvenance(const AreaBuildOptions& options,
                          const AreaBuild& build,
                          const std::map<std::string, std::int64_t>& in_logs) {
  const MapperResult& result = build.result;
  Provenance provenance;
  provenance.tool = "shiftmap-mapper " + SoftwareVersion();
  Json configuration = Json{{"revision", SoftwareRevision()},
                            {"selector", options.selector},
                            {"engine", options.engine},
                            {"poses", options.engine == "tree" ? "filtered" : "smoothed"},
                            {"solver", options.solver},
                            {"prior", options.prior},
                            {"anonymous", options.anonymous},
                            {"placement", options.placement},
                            {"calibrate", !options.no_calibration},
                            {"leave_rate_per_s", options.leave_rate_per_s},
                            {"learned_rates", !options.no_learned_rates},
                            {"vehicles", VehiclesJson(result.vehicles)},
                            {"outcome", OutcomeJson(result, build.at_two_places, in_logs)}};
  if (!options.night.empty()) configuration["night"] = options.night;
  if (options.engine == "tree") {
    configuration["tree"] = {{"field_of_view", options.field_of_view},
                             {"leaves", options.tree.max_leaves},
                             {"alpha", options.tree.alpha},
                             {"update_ungated", options.tree.update_ungated},
                             {"transform", options.tree.transform_alternative},
                             {"insertion", options.tree_insertion},
                             {"merging", options.tree_merging}};
  }
  // Names are any bytes.
  provenance.configuration = configuration.dump(-1, ' ', false, Json::error_handler_t::replace);
  provenance.seed = static_cast<std::int64_t>(options.seed);
  for (const MappedRun& run : result.runs) {
    RunRecord& record = provenance.runs.emplace_back(run);
    record.trajectory = Thinned(run.trajectory);
  }
  provenance.older = result.older;
  return provenance;
}

}  // namespace shiftmap
