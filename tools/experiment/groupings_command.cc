// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/groupings_command.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/core/quantile.h"
#include "mapstore/map_store.h"
#include "tools/experiment/experiment_output.h"
#include "tools/experiment/map_difference.h"
#include "tools/experiment/nights.h"
#include "tools/experiment/nights_command.h"

namespace shiftmap {
namespace {

// How the days of a site are grouped into builds.
struct Grouping {
  std::string name;
  int nights_per_build = 1;
  bool return_at_once = false;
};

// The first is the reference: one batch of all runs.
std::vector<Grouping> Groupings(int nights) {
  return {{"batch", nights, false},
          {"every night", 1, false},
          {"every night, returned at once", 1, true},
          {"every 3 nights", 3, false},
          {"every 3 nights, returned at once", 3, true},
          {"every 7 nights", 7, false}};
}

// The published maps of two stores, at one time.
StatusOr<MapDifference> CompareStores(const std::string& reference, const std::string& other) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore first, MapStore::Open(reference, MapStore::Access::kReadOnly));
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore second, MapStore::Open(other, MapStore::Access::kReadOnly));
  SHIFTMAP_ASSIGN_OR_RETURN(MapSnapshot expected, first.LoadAt(kSiteArea));
  SHIFTMAP_ASSIGN_OR_RETURN(MapSnapshot map, second.LoadAt(kSiteArea));
  const Stamp at = std::max(expected.content().stamp, map.content().stamp);
  SHIFTMAP_ASSIGN_OR_RETURN(expected, first.LoadAt(kSiteArea, std::nullopt, at));
  SHIFTMAP_ASSIGN_OR_RETURN(map, second.LoadAt(kSiteArea, std::nullopt, at));
  return CompareMaps(expected.groups(), map.groups());
}

void AddRow(std::uint64_t seed,
            const std::string& grouping,
            const NightResult& last,
            const MapDifference& difference,
            ResultTable* table) {
  std::vector<double> ratios;
  for (const double log_ratio : difference.log_rate_ratios) {
    ratios.push_back(std::exp(std::abs(log_ratio)) - 1.0);
  }
  if (ratios.empty()) ratios.push_back(std::numeric_limits<double>::quiet_NaN());
  table->AddRow({static_cast<double>(seed),
                 grouping,
                 static_cast<double>(last.unmapped),
                 static_cast<double>(difference.modes),
                 static_cast<double>(difference.missing_modes),
                 static_cast<double>(difference.added_modes),
                 difference.position_rms_m,
                 difference.position_max_m,
                 static_cast<double>(difference.sure),
                 static_cast<double>(difference.other_state),
                 difference.variation,
                 difference.variation_max,
                 Quantile(ratios, 0.5),
                 Quantile(ratios, 1.0)});
}

Status RunGroupings(const SiteArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("groupings", arguments.output, context.dry_run()));
  ResultTable table({"seed",
                     "builds",
                     "unmapped",
                     "modes",
                     "missing_modes",
                     "added_modes",
                     "position_rms_m",
                     "position_max_m",
                     "sure",
                     "other_state",
                     "variation",
                     "variation_max",
                     "rate_change_median",
                     "rate_change_max"});
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  const std::vector<Grouping> groupings = Groupings(arguments.nights.nights);
  NightsOptions options = arguments.nights;
  const int total = context.dry_run() ? 0 : arguments.worlds;
  const double sites = static_cast<double>(groupings.size()) * total;
  double done = 0.0;
  for (int i = 0; i < total; ++i, ++options.seed) {
    std::string reference;
    for (const Grouping& grouping : groupings) {
      options.nights_per_build = grouping.nights_per_build;
      options.return_at_once = grouping.return_at_once;
      const std::string folder =
          fmt::format("{}/{}-{}", arguments.work, options.seed, &grouping - groupings.data());
      SHIFTMAP_ASSIGN_OR_RETURN(
          const NightsResult result,
          DriveNights(options, folder, {}, [&](const NightResult& night) {
            progress->Update(fmt::format("site {}, {}", options.seed, grouping.name),
                             (done + static_cast<double>(night.night) / options.nights) / sites);
          }));
      ++done;
      if (reference.empty()) reference = SiteStore(folder);
      SHIFTMAP_ASSIGN_OR_RETURN(const MapDifference difference,
                                CompareStores(reference, SiteStore(folder)));
      AddRow(options.seed, grouping.name, result.nights.back(), difference, &table);
    }
  }
  return output.Report({{"seed", arguments.nights.seed},
                        {"worlds", arguments.worlds},
                        {"nights", options.nights},
                        {"vehicles", options.vehicles},
                        {"groups", options.groups},
                        {"size_m", options.size_m},
                        {"duration_s", options.duration_s}},
                       table,
                       &context);
}

}  // namespace

void AddGroupingsExperiment(Application* application) {
  auto arguments = std::make_shared<SiteArguments>();
  Command& command = application->AddCommand(
      "groupings",
      "The same days of simulated sites, built every night, every few, or in one batch",
      [arguments](Context& context) { return RunGroupings(*arguments, context); });
  AddSiteOptions(arguments.get(), &command);
  command.Option("--nights", &arguments->nights.nights, "Days, and nights after them")
      .InRange(2, 300)
      .Writes();
}

}  // namespace shiftmap
