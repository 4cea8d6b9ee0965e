// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/vehicle_faults_command.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/experiment/experiment_output.h"
#include "tools/experiment/nights.h"
#include "tools/experiment/nights_command.h"

namespace shiftmap {
namespace {

void Add(const RecoveryCount& night, RecoveryCount* sum) {
  sum->states += night.states;
  sum->wrong_likeliest += night.wrong_likeliest;
  sum->doubtful += night.doubtful;
  sum->p_true_min = std::min(sum->p_true_min, night.p_true_min);
}

// A row per site and fault: the nights with the fault together, and the map after the last of them.
void AddRow(std::uint64_t seed,
            VehicleFault fault,
            const std::vector<NightResult>& nights,
            ResultTable* table) {
  NightResult sum;
  for (const NightResult& night : nights) {
    sum.shifts += night.shifts;
    sum.localized += night.localized;
    sum.wrong_starts += night.wrong_starts;
    sum.decisions += night.decisions;
    sum.wrong_decisions += night.wrong_decisions;
    sum.states += night.states;
    sum.p_true_sum += night.p_true_sum;
    sum.wrong_likeliest += night.wrong_likeliest;
    sum.wrong_sure += night.wrong_sure;
    Add(night.after_one, &sum.after_one);
    Add(night.after_two, &sum.after_two);
  }
  const NightResult& last = nights.back();
  table->AddRow({static_cast<double>(seed),
                 FaultName(fault),
                 static_cast<double>(sum.shifts),
                 static_cast<double>(sum.localized),
                 static_cast<double>(sum.wrong_starts),
                 static_cast<double>(sum.decisions),
                 static_cast<double>(sum.wrong_decisions),
                 static_cast<double>(sum.states),
                 sum.p_true_sum / sum.states,
                 static_cast<double>(sum.wrong_likeliest),
                 static_cast<double>(sum.wrong_sure),
                 static_cast<double>(sum.after_one.states),
                 static_cast<double>(sum.after_one.wrong_likeliest),
                 static_cast<double>(sum.after_two.states),
                 static_cast<double>(sum.after_two.wrong_likeliest),
                 static_cast<double>(sum.after_two.doubtful),
                 sum.after_two.p_true_min,
                 static_cast<double>(last.modes),
                 static_cast<double>(last.wrong_modes),
                 last.map_rmse_m,
                 static_cast<double>(last.unmapped)});
}

Status RunVehicleFaults(const SiteArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("vehicle-faults", arguments.output, context.dry_run()));
  ResultTable table({"seed",
                     "fault",
                     "shifts",
                     "localized",
                     "wrong_starts",
                     "decisions",
                     "wrong_decisions",
                     "states",
                     "p_true_mean",
                     "wrong_likeliest",
                     "wrong_sure",
                     "after_one",
                     "after_one_wrong",
                     "after_two",
                     "after_two_wrong",
                     "after_two_below_095",
                     "after_two_p_min",
                     "modes",
                     "wrong_modes",
                     "map_rmse_m",
                     "unmapped"});
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  const std::vector<VehicleFault> faults = AllVehicleFaults();
  NightsOptions options = arguments.nights;
  options.return_at_once = true;
  options.nights = options.fault_night + options.fault_nights - 1;
  const int total = context.dry_run() ? 0 : arguments.worlds;
  const double sites = static_cast<double>(faults.size()) * total;
  double done = 0.0;
  for (int i = 0; i < total; ++i, ++options.seed) {
    for (const VehicleFault fault : faults) {
      options.fault = fault;
      const std::string name = fmt::format("site {}, {}", options.seed, FaultName(fault));
      SHIFTMAP_ASSIGN_OR_RETURN(
          const NightsResult result,
          DriveNights(options,
                      fmt::format("{}/{}-{}", arguments.work, options.seed, FaultName(fault)),
                      {},
                      [&](const NightResult& night) {
                        progress->Update(
                            name,
                            (done + static_cast<double>(night.night) / options.nights) / sites);
                      }));
      const auto first = result.nights.begin() + options.fault_night - 1;
      AddRow(options.seed, fault, {first, result.nights.end()}, &table);
      ++done;
    }
  }
  return output.Report({{"seed", arguments.nights.seed},
                        {"worlds", arguments.worlds},
                        {"vehicles", options.vehicles},
                        {"groups", options.groups},
                        {"size_m", options.size_m},
                        {"duration_s", options.duration_s},
                        {"fault_night", options.fault_night},
                        {"fault_nights", options.fault_nights}},
                       table,
                       &context);
}

}  // namespace

void AddVehicleFaultsExperiment(Application* application) {
  auto arguments = std::make_shared<SiteArguments>();
  NightsOptions& nights = arguments->nights;
  nights.fault_nights = 10;
  Command& command = application->AddCommand(
      "vehicle-faults",
      "What a broken or lying vehicle, the first one, does to the fleet's map of simulated sites",
      [arguments](Context& context) { return RunVehicleFaults(*arguments, context); });
  AddSiteOptions(arguments.get(), &command);
  command.Option("--fault-night", &nights.fault_night, "The first night with the fault")
      .InRange(2, 300)
      .Option("--fault-nights", &nights.fault_nights, "Nights with it, the last ones")
      .InRange(1, 300)
      .Writes();
}

}  // namespace shiftmap
