// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ledger_years_command.h"

#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "mapstore/core/folder.h"
#include "mapstore/core/quantile.h"
#include "tools/experiment/experiment_output.h"
#include "tools/experiment/ledger_years.h"

namespace shiftmap {
namespace {

struct Arguments {
  std::string output;
  std::string work;
  bool full = false;
  LedgerYearsOptions options;
};

// How far two stores of the same visits are from each other.
struct Difference {
  double rate_median = std::numeric_limits<double>::quiet_NaN();  // Relative.
  double rate_max = std::numeric_limits<double>::quiet_NaN();
  double probability_max = std::numeric_limits<double>::quiet_NaN();
};

Difference Compare(const LedgerYear& full, const LedgerYear& summed) {
  std::vector<double> changes;
  for (std::size_t i = 0; i < std::min(full.rates.size(), summed.rates.size()); ++i) {
    changes.push_back(std::abs(summed.rates[i] / full.rates[i] - 1.0));
  }
  Difference difference;
  if (!changes.empty()) {
    difference.rate_median = Quantile(changes, 0.5);
    difference.rate_max = Quantile(changes, 1.0);
  }
  difference.probability_max = 0.0;
  for (std::size_t i = 0; i < full.probabilities.size(); ++i) {
    difference.probability_max = std::max(
        difference.probability_max, std::abs(full.probabilities[i] - summed.probabilities[i]));
  }
  return difference;
}

void AddYear(const std::string& rows,
             const LedgerYear& year,
             const Difference& difference,
             ResultTable* table) {
  table->AddRow({rows,
                 static_cast<double>(year.year),
                 year.visits,
                 year.rows,
                 year.store_mib,
                 year.return_s,
                 year.compact_s,
                 year.load_s,
                 year.evidence_s,
                 year.fit_s,
                 difference.rate_median,
                 difference.rate_max,
                 difference.probability_max});
}

Status Run(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      ExperimentOutput output,
      ExperimentOutput::Create("ledger-years", arguments.output, context.dry_run()));
  ResultTable table({"rows_kept",
                     "year",
                     "visits",
                     "rows",
                     "store_mib",
                     "return_s",
                     "compact_s",
                     "load_s",
                     "evidence_s",
                     "fit_s",
                     "rate_change_median",
                     "rate_change_max",
                     "probability_change_max"});
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  if (!context.dry_run()) {
    SHIFTMAP_RETURN_IF_ERROR(MakeFolder(arguments.work));
    std::vector<LedgerYear> full;
    if (arguments.full) {
      LedgerYearsOptions options = arguments.options;
      options.compacts = false;
      SHIFTMAP_ASSIGN_OR_RETURN(
          full, RunLedgerYears(options, arguments.work + "/all.db", [&](double done) {
            progress->Update("all rows", 0.5 * done);
          }));
      for (const LedgerYear& year : full) AddYear("all", year, {}, &table);
    }
    SHIFTMAP_ASSIGN_OR_RETURN(
        const std::vector<LedgerYear> summed,
        RunLedgerYears(arguments.options, arguments.work + "/summed.db", [&](double done) {
          progress->Update("summed up", arguments.full ? 0.5 + 0.5 * done : done);
        }));
    for (std::size_t i = 0; i < summed.size(); ++i) {
      AddYear("summed up",
              summed[i],
              i < full.size() ? Compare(full[i], summed[i]) : Difference(),
              &table);
    }
  }
  const LedgerYearsOptions& options = arguments.options;
  return output.Report({{"seed", options.seed},
                        {"groups", options.groups},
                        {"years", options.years},
                        {"vehicles", options.vehicles},
                        {"visits_per_day", options.visits_per_day},
                        {"stay_days", options.stay_days},
                        {"keep_days", options.keep_days},
                        {"build_days", options.build_days}},
                       table,
                       &context);
}

}  // namespace

void AddLedgerYearsExperiment(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  LedgerYearsOptions& options = arguments->options;
  application
      ->AddCommand("ledger-years",
                   "Size and time of years of visits in one store, with rows summed up",
                   [arguments](Context& context) { return Run(*arguments, context); })
      .Option("--output", &arguments->output, "Folder for CSV and JSON")
      .Required()
      .Option("--work", &arguments->work, "Folder for the stores")
      .Required()
      .Option("--seed", &options.seed, "Seed of everything random")
      .Option("--groups", &options.groups, "Landmarks")
      .InRange(1, 100000)
      .Option("--years", &options.years, "Years")
      .InRange(1, 20)
      .Option("--vehicles", &options.vehicles, "Vehicles")
      .InRange(1, 1000)
      .Option("--visits-per-day", &options.visits_per_day, "Visits of each landmark a day")
      .InRange(0.01, 1000.0)
      .Flag("--full", &arguments->full, "The same without summing up, and what that changes")
      .Writes();
}

}  // namespace shiftmap
