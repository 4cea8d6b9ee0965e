// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/nights_command.h"

#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "tools/experiment/experiment_output.h"
#include "tools/experiment/nights.h"

namespace shiftmap {
namespace {

struct Arm {
  std::string name;
  std::vector<std::string> night_words;
};

struct Driven {
  std::uint64_t seed = 0;
  std::string arm;
  NightsResult result;
};

ResultTable NightTable(const std::vector<Driven>& all) {
  ResultTable table(
      {"seed",         "rates",       "night",         "shifts",          "localized",
       "wrong_starts", "start_s",     "rmse_m",        "decisions",       "wrong_decisions",
       "states",       "p_true_mean", "log_p_true",    "wrong_likeliest", "sure",
       "wrong_sure",   "new_places",  "modes",         "wrong_modes",     "map_rmse_m",
       "unmapped",     "waiting",     "waited_nights", "night_s",         "store_mib"});
  for (const Driven& driven : all) {
    for (const NightResult& night : driven.result.nights) {
      table.AddRow({static_cast<double>(driven.seed),
                    driven.arm,
                    static_cast<double>(night.night),
                    static_cast<double>(night.shifts),
                    static_cast<double>(night.localized),
                    static_cast<double>(night.wrong_starts),
                    night.start_s_sum / night.localized,
                    night.rmse_m,
                    static_cast<double>(night.decisions),
                    static_cast<double>(night.wrong_decisions),
                    static_cast<double>(night.states),
                    night.p_true_sum / night.states,
                    night.log_p_true_sum / night.states,
                    static_cast<double>(night.wrong_likeliest),
                    static_cast<double>(night.sure),
                    static_cast<double>(night.wrong_sure),
                    static_cast<double>(night.new_places),
                    static_cast<double>(night.modes),
                    static_cast<double>(night.wrong_modes),
                    night.map_rmse_m,
                    static_cast<double>(night.unmapped),
                    static_cast<double>(night.waiting),
                    static_cast<double>(night.waited_nights),
                    night.night_s,
                    night.store_mib});
    }
  }
  return table;
}

ResultTable RemovalTable(const std::vector<Driven>& all) {
  ResultTable table({"seed", "rates", "landmark", "removed_run", "absent_after_days"});
  for (const Driven& driven : all) {
    for (const Removal& removal : driven.result.removals) {
      table.AddRow({static_cast<double>(driven.seed),
                    driven.arm,
                    removal.signature.text(),
                    static_cast<double>(removal.removed_run),
                    removal.absent_after_days});
    }
  }
  return table;
}

// A line per arm: a quotient of sums over all worlds, by night.
template <typename Over, typename Under>
void AddLines(const std::vector<Arm>& arms,
              const std::vector<Driven>& all,
              const std::string& what,
              Over over,
              Under under,
              Chart* chart) {
  for (const Arm& arm : arms) {
    std::vector<Eigen::Vector2d> sums;
    for (const Driven& driven : all) {
      if (driven.arm != arm.name) continue;
      sums.resize(driven.result.nights.size(), Eigen::Vector2d::Zero());
      for (std::size_t i = 0; i < sums.size(); ++i) {
        const NightResult& night = driven.result.nights[i];
        sums[i] += Eigen::Vector2d(over(night), under(night));
      }
    }
    ChartSeries& series = SeriesNamed(what + arm.name, chart);
    for (std::size_t i = 0; i < sums.size(); ++i) {
      series.points.emplace_back(static_cast<double>(i) + 1.0, sums[i].x() / sums[i].y());
    }
  }
}

Status WriteFigures(const std::vector<Arm>& arms,
                    const std::vector<Driven>& all,
                    ExperimentOutput* output) {
  Chart states{"Probability of the true state when a shift begins", "day", "mean probability"};
  AddLines(
      arms,
      all,
      "rates: ",
      [](const NightResult& night) { return night.p_true_sum; },
      [](const NightResult& night) { return night.states; },
      &states);
  SHIFTMAP_RETURN_IF_ERROR(output->WriteFigure("states", states));
  Chart errors{"Errors by day", "day", "RMSE [m]"};
  const auto one = [](const NightResult&) { return 1.0; };
  AddLines(
      arms, all, "poses, ", [](const NightResult& night) { return night.rmse_m; }, one, &errors);
  AddLines(
      arms,
      all,
      "modes, ",
      [](const NightResult& night) { return night.map_rmse_m; },
      one,
      &errors);
  return output->WriteFigure("errors", errors);
}

Status RunNights(const SiteArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("nights", arguments.output, context.dry_run()));
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput removals,
      ExperimentOutput::Create("nights-removals", arguments.output, context.dry_run()));
  const std::vector<Arm> arms = {{"learned", {}}, {"default", {"--no-learned-rates"}}};
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  std::vector<Driven> all;
  const int total = context.dry_run() ? 0 : arguments.worlds;
  for (int i = 0; i < total; ++i) {
    for (const Arm& arm : arms) {
      NightsOptions options = arguments.nights;
      options.seed += static_cast<std::uint64_t>(i);
      const double done = static_cast<double>(all.size());
      const auto runs = static_cast<double>(arms.size()) * total;
      SHIFTMAP_ASSIGN_OR_RETURN(
          NightsResult result,
          DriveNights(options,
                      fmt::format("{}/{}-{}", arguments.work, options.seed, arm.name),
                      arm.night_words,
                      [&](const NightResult& night) {
                        progress->Update(
                            fmt::format("world {}, {} rates", options.seed, arm.name),
                            (done + static_cast<double>(night.night) / options.nights) / runs);
                      }));
      all.push_back({options.seed, arm.name, std::move(result)});
    }
  }
  const ResultTable nights = NightTable(all);
  const ResultTable removed = RemovalTable(all);
  SHIFTMAP_RETURN_IF_ERROR(WriteFigures(arms, all, &output));
  const Json options{{"seed", arguments.nights.seed},
                     {"worlds", arguments.worlds},
                     {"nights", arguments.nights.nights},
                     {"vehicles", arguments.nights.vehicles},
                     {"groups", arguments.nights.groups},
                     {"size_m", arguments.nights.size_m},
                     {"duration_s", arguments.nights.duration_s},
                     {"layout_days", arguments.nights.layout_days},
                     {"layout_share", arguments.nights.layout_share}};
  return output.ReportBoth(options, nights, removed, &removals, &context);
}

}  // namespace

void AddSiteOptions(SiteArguments* arguments, Command* command) {
  NightsOptions& nights = arguments->nights;
  command->Option("--output", &arguments->output, "Folder for the results")
      .Required()
      .Option("--work", &arguments->work, "Folder for logs, reports and stores, which stay there")
      .Required()
      .Option("--worlds", &arguments->worlds, "Sites")
      .InRange(1, 10000)
      .Option("--vehicles", &nights.vehicles, "A shift each, every day")
      .InRange(1, 100)
      .Option("--groups", &nights.groups, "Landmarks")
      .InRange(3, 10000)
      .Option("--size-m", &nights.size_m, "Edge of the floor")
      .InRange(5.0, 1e4)
      .Option("--duration-s", &nights.duration_s, "Of a shift")
      .InRange(10.0, 1e5)
      .Option("--seed", &nights.seed, "Seed of the first site");
}

void AddNightsExperiment(Application* application) {
  auto arguments = std::make_shared<SiteArguments>();
  NightsOptions& nights = arguments->nights;
  Command& command = application->AddCommand(
      "nights",
      "Days and nights of simulated sites, through the commands of a site",
      [arguments](Context& context) { return RunNights(*arguments, context); });
  AddSiteOptions(arguments.get(), &command);
  command.Option("--nights", &nights.nights, "Days, and nights after them")
      .InRange(1, 300)
      .Option("--layout-days",
              &nights.layout_days,
              "Every so many days much of what moves does so at once; 0: never")
      .InRange(0, 300)
      .Option("--layout-share", &nights.layout_share, "Share of landmarks that do")
      .InRange(0.0, 1.0)
      .Writes();
}

}  // namespace shiftmap
