// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/fleet_nights_command.h"

#include <fmt/format.h>

#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/experiment/experiment_output.h"
#include "tools/experiment/nights.h"
#include "tools/experiment/nights_command.h"

namespace shiftmap {
namespace {

ResultTable FleetTable(const std::vector<NightsResult>& areas) {
  ResultTable table({"area",          "night",          "shifts",          "localized",
                     "rmse_m",        "decisions",      "wrong_decisions", "states",
                     "p_true_mean",   "modes",          "wrong_modes",     "map_rmse_m",
                     "frame_shift_m", "frame_turn_rad", "unmapped",        "waiting",
                     "held",          "published",      "night_s",         "store_mib"});
  for (std::size_t area = 0; area < areas.size(); ++area) {
    for (const NightResult& night : areas[area].nights) {
      table.AddRow({static_cast<double>(area),
                    static_cast<double>(night.night),
                    static_cast<double>(night.shifts),
                    static_cast<double>(night.localized),
                    night.rmse_m,
                    static_cast<double>(night.decisions),
                    static_cast<double>(night.wrong_decisions),
                    static_cast<double>(night.states),
                    night.p_true_sum / night.states,
                    static_cast<double>(night.modes),
                    static_cast<double>(night.wrong_modes),
                    night.map_rmse_m,
                    night.frame_shift_m,
                    night.frame_turn_rad,
                    static_cast<double>(night.unmapped),
                    static_cast<double>(night.waiting),
                    static_cast<double>(night.held),
                    night.published ? 1.0 : 0.0,
                    night.night_s,
                    night.store_mib});
    }
  }
  return table;
}

// A line of quotients of sums over all areas, by night.
void AddLine(const std::vector<NightsResult>& areas,
             const std::string& name,
             const std::function<double(const NightResult&)>& over,
             const std::function<double(const NightResult&)>& under,
             Chart* chart) {
  ChartSeries& series = SeriesNamed(name, chart);
  for (std::size_t i = 0; i < areas.front().nights.size(); ++i) {
    double sum_over = 0.0;
    double sum_under = 0.0;
    for (const NightsResult& area : areas) {
      const NightResult& night = area.nights[i];
      if (!(under(night) > 0.0)) continue;
      sum_over += over(night);
      sum_under += under(night);
    }
    series.points.emplace_back(static_cast<double>(i) + 1.0, sum_over / sum_under);
  }
}

// How far the frames of pairs of areas move, the second of each with control points.
Status WriteFrames(const std::vector<NightsResult>& areas, ExperimentOutput* output) {
  Chart shift{"Shift of the map's frame since the first night", "night", "m"};
  Chart turn{"Turn of the map's frame since the first night", "night", "rad"};
  for (std::size_t area = 0; area < areas.size(); ++area) {
    const std::string name = area % 2 == 0 ? "no control points" : "control points";
    const std::string of_area = areas.size() > 2 ? fmt::format("{}, {}", area / 2, name) : name;
    for (const NightResult& night : areas[area].nights) {
      SeriesNamed(of_area, &shift).points.emplace_back(night.night, night.frame_shift_m);
      SeriesNamed(of_area, &turn).points.emplace_back(night.night, night.frame_turn_rad);
    }
  }
  for (Chart* const chart : {&shift, &turn}) {
    for (ChartSeries& series : chart->series) series.marker_radius = 1.0;
  }
  SHIFTMAP_RETURN_IF_ERROR(output->WriteFigure("frame-shift", shift));
  return output->WriteFigure("frame-turn", turn);
}

Status WriteFigures(const std::vector<NightsResult>& areas, ExperimentOutput* output) {
  Chart errors{"Errors by night, over all areas", "night", "error [m], share [-]"};
  errors.log_y = true;
  AddLine(
      areas,
      "map, RMS [m]",
      [](const NightResult& night) { return night.map_rmse_m; },
      [](const NightResult& night) { return night.modes > 0 ? 1.0 : 0.0; },
      &errors);
  AddLine(
      areas,
      "poses, RMS [m]",
      [](const NightResult& night) { return night.rmse_m; },
      [](const NightResult& night) { return night.localized > 0 ? 1.0 : 0.0; },
      &errors);
  AddLine(
      areas,
      "wrong decisions",
      [](const NightResult& night) { return night.wrong_decisions; },
      [](const NightResult& night) { return night.decisions; },
      &errors);
  AddLine(
      areas,
      "1 − P(true state)",
      [](const NightResult& night) { return night.states - night.p_true_sum; },
      [](const NightResult& night) { return night.states; },
      &errors);
  SHIFTMAP_RETURN_IF_ERROR(output->WriteFigure("errors", errors));
  Chart store{"Size of the store", "night", "MiB"};
  ChartSeries& size = SeriesNamed("", &store);
  for (const NightResult& night : areas.front().nights) {
    size.points.emplace_back(night.night, night.store_mib);
  }
  return output->WriteFigure("store", store);
}

Status RunFleetNights(const SiteArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("fleet-nights", arguments.output, context.dry_run()));
  const bool pairs = arguments.control_points > 0;
  std::vector<NightsOptions> sites;
  for (int i = 0; i < arguments.worlds; ++i) {
    NightsOptions site = arguments.nights;
    site.seed += static_cast<std::uint64_t>(i);
    // One vehicle of the first area has a broken odometer for a day.
    site.fault = i == 0 ? VehicleFault::kFrozenOdometer : VehicleFault::kNone;
    site.fault_night = (site.nights + 1) / 2;
    site.fault_nights = i == 0 ? 1 : 0;
    sites.push_back(site);
    if (!pairs) continue;
    site.control_points = arguments.control_points;
    sites.push_back(site);
  }
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  std::vector<NightsResult> areas;
  if (!context.dry_run()) {
    // What there is so far is kept: it is a long way to the last night.
    Status written;
    SHIFTMAP_ASSIGN_OR_RETURN(
        areas,
        DriveFleet(sites,
                   arguments.work + "/fleet",
                   {"--judge-shifts", std::to_string(arguments.judge_shifts)},
                   [&](const std::vector<NightsResult>& now) {
                     const auto night = static_cast<double>(now.front().nights.size());
                     progress->Update("fleet", night / arguments.nights.nights);
                     if (written.ok()) written = output.WriteTable(FleetTable(now));
                   }));
    SHIFTMAP_RETURN_IF_ERROR(written);
    SHIFTMAP_RETURN_IF_ERROR(WriteFigures(areas, &output));
    if (pairs) SHIFTMAP_RETURN_IF_ERROR(WriteFrames(areas, &output));
  }
  const ResultTable table = FleetTable(areas);
  const Json options{{"seed", arguments.nights.seed},
                     {"areas", arguments.worlds},
                     {"nights", arguments.nights.nights},
                     {"vehicles", arguments.nights.vehicles},
                     {"groups", arguments.nights.groups},
                     {"size_m", arguments.nights.size_m},
                     {"duration_s", arguments.nights.duration_s},
                     {"control_points", arguments.control_points},
                     {"judge_shifts", arguments.judge_shifts}};
  SHIFTMAP_ASSIGN_OR_RETURN(const Json document, output.WriteDocument(options, table));
  context.Report(document, table.ToText());
  return OkStatus();
}

}  // namespace

void AddFleetNightsExperiment(Application* application) {
  auto arguments = std::make_shared<SiteArguments>();
  arguments->worlds = 10;
  Command& command = application->AddCommand(
      "fleet-nights",
      "Nights over the areas of a fleet in one store, one of them with a broken odometer",
      [arguments](Context& context) { return RunFleetNights(*arguments, context); });
  AddSiteOptions(arguments.get(), &command);
  command.Option("--nights", &arguments->nights.nights, "Days, and nights after them")
      .InRange(1, 300)
      .Option("--control-points",
              &arguments->control_points,
              "After each area the same once more, with so many landmarks surveyed after its first "
              "night; 0: without")
      .InRange(0, 1000)
      .Option("--judge-shifts",
              &arguments->judge_shifts,
              "Shifts that each night replays to judge its maps, and as many of its own")
      .InRange(1, 1000)
      .Writes();
}

}  // namespace shiftmap
