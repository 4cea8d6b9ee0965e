// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/tiv_removal_command.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "mapper/parallel.h"
#include "tools/experiment/experiment_output.h"
#include "tools/experiment/sample_mean.h"
#include "tools/experiment/tiv_arguments.h"
#include "tools/experiment/tiv_removal.h"

namespace shiftmap {
namespace {

// Apart from the seeds of the drives that are judged.
constexpr std::uint64_t kMapSeeds = 700'000'000;

constexpr double kShares[] = {0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0};

struct Method {
  const char* name;
  double TivRemovalRun::*distance_m;
};

constexpr Method kMethods[] = {{"multi, best active", &TivRemovalRun::best_active},
                               {"multi, most likely", &TivRemovalRun::most_likely},
                               {"memory decay", &TivRemovalRun::memory_decay},
                               {"outlier rejection", &TivRemovalRun::rejection},
                               {"dead reckoning", &TivRemovalRun::reckoning}};

double Rmse(const std::vector<TivRemovalRun>& runs, double TivRemovalRun::*distance_m) {
  double sum = 0.0;
  for (const TivRemovalRun& run : runs) sum += std::pow(run.*distance_m, 2);
  return std::sqrt(sum / static_cast<double>(runs.size()));
}

// By how many standard errors the likeliest leaf's squared distances exceed another method's in the
// same drives; negative if they are smaller.
double Excess(const std::vector<TivRemovalRun>& runs, double TivRemovalRun::*other) {
  std::vector<double> differences;
  for (const TivRemovalRun& run : runs) {
    differences.push_back(std::pow(run.most_likely, 2) - std::pow(run.*other, 2));
  }
  const SampleMean mean = MeanOf(differences);
  return mean.standard_error > 0.0 ? mean.mean / mean.standard_error : 0.0;
}

// By share.
using Runs = std::vector<std::vector<TivRemovalRun>>;

StatusOr<std::vector<TivRemovalRun>> RunShares(const TivWorld& world,
                                               const TivArguments& arguments,
                                               std::size_t i) {
  const std::uint64_t seed = arguments.SeedOf(i);
  SHIFTMAP_ASSIGN_OR_RETURN(const TivWorld own, arguments.WorldOf(world, i));
  SHIFTMAP_ASSIGN_OR_RETURN(const TivWorld both, MapBothVersions(own, kMapSeeds + seed));
  std::vector<TivRemovalRun> by_share;
  for (const double share : kShares) {
    SHIFTMAP_ASSIGN_OR_RETURN(const TivRemovalRun run, RunTivRemoval(both, share, seed));
    by_share.push_back(run);
  }
  return by_share;
}

StatusOr<Runs> RunAll(const TivWorld& world, const TivArguments& arguments) {
  std::vector<StatusOr<std::vector<TivRemovalRun>>> results(
      static_cast<std::size_t>(arguments.runs), std::vector<TivRemovalRun>());
  ForEachIndex(results.size(), arguments.threads, [&](std::size_t i) {
    results[i] = RunShares(world, arguments, i);
  });
  Runs runs(std::size(kShares));
  for (const StatusOr<std::vector<TivRemovalRun>>& result : results) {
    SHIFTMAP_RETURN_IF_ERROR(result.status());
    for (std::size_t s = 0; s < runs.size(); ++s) runs[s].push_back((*result)[s]);
  }
  return runs;
}

Status Measure(const TivArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("tiv-removal", arguments.output, context.dry_run()));
  TivOptions options = arguments.World();
  options.start_sd_m = 0.2;  // diag(0.04, 0.04, 0.0023) of T-IV IX-F.
  options.start_sd_rad = std::sqrt(0.0023);
  SHIFTMAP_ASSIGN_OR_RETURN(const TivWorld world, TivWorld::Make(options));
  ResultTable table({"share_removed", "method", "rmse_m", "most_likely_exceeds_by_se"});
  Chart chart{.title = "Landmarks that stay are removed",
              .x_label = "share removed",
              .y_label = "final RMSE of the position [m]",
              .log_y = true};
  SHIFTMAP_ASSIGN_OR_RETURN(const Runs runs, RunAll(world, arguments));
  for (std::size_t s = 0; s < std::size(kShares); ++s) {
    for (const Method& method : kMethods) {
      const double rmse = Rmse(runs[s], method.distance_m);
      table.AddRow(
          {kShares[s], std::string(method.name), rmse, Excess(runs[s], method.distance_m)});
      SeriesNamed(method.name, &chart).points.emplace_back(kShares[s], rmse);
    }
  }
  SHIFTMAP_RETURN_IF_ERROR(output.WriteFigure("rmse", chart));
  return output.Report(arguments.OptionsJson(), table, &context);
}

}  // namespace

void AddTivRemovalExperiment(Application* application) {
  auto arguments = std::make_shared<TivArguments>();
  Command& command = application->AddCommand(
      "tiv-removal",
      "T-IV figure 7: landmarks that stay are removed from map and scans",
      [arguments](Context& context) { return Measure(*arguments, context); });
  arguments->AddTo(&command);
}

}  // namespace shiftmap
