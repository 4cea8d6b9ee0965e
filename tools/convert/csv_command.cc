// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/csv_command.h"

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "mapstore/codec/run_log.h"
#include "tools/convert/csv_run.h"
#include "tools/convert/run_report.h"

namespace shiftmap {
namespace {

struct CsvArguments {
  CsvRunOptions options;
  std::string output;
  std::optional<std::string> truth;
};

Status RunCsv(const CsvArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const CsvRun csv, ReadCsvRun(arguments.options));
  for (const std::string& column : csv.ignored_columns) context.Warn(column + " is not used");
  if (!context.dry_run()) {
    SHIFTMAP_RETURN_IF_ERROR(WriteRunLog(csv.run, arguments.output));
    if (arguments.truth) SHIFTMAP_RETURN_IF_ERROR(WriteTum(csv.truth, *arguments.truth));
  }
  Json more = {{"ignored_columns", csv.ignored_columns}};
  if (arguments.truth) more["truth_poses"] = csv.truth.size();
  ReportRun(arguments.output, csv.run, more, context);
  return OkStatus();
}

}  // namespace

void AddCsvCommand(Application* application) {
  auto arguments = std::make_shared<CsvArguments>();
  CsvRunOptions& options = arguments->options;
  options.info.vehicle = "robot";
  options.info.source = "csv";
  application
      ->AddCommand("csv",
                   "Convert tables of odometry and observations",
                   [arguments](Context& context) { return RunCsv(*arguments, context); })
      .Writes()
      .Option("--odometry", &options.odometry, "Table: stamp_s,v_mps,omega_radps")
      .Required()
      .Option("--observations",
              &options.observations,
              "Table: stamp_s,signature and range_m,bearing_rad or x_m,y_m, with sd_ of both or "
              "without")
      .Required()
      .Option("--output", &arguments->output, "Run log to write")
      .Output()
      .Required()
      .Option("--vehicle", &options.info.vehicle, "Name of the vehicle, unique in the fleet")
      .Option("--area", &options.info.area, "Area that the run is in")
      .Option("--run-uuid",
              &options.info.uuid,
              "Identity of the run (default: none, the log's hash counts)")
      .Option("--truth-table", &options.truth, "Table of true poses: stamp_s,x_m,y_m,yaw_rad")
      .Option("--truth", &arguments->truth, "Write the true trajectory here, needs --truth-table")
      .Check([arguments] {
        if (arguments->truth.has_value() == !arguments->options.truth.empty()) return std::string();
        return std::string("--truth and --truth-table need each other");
      });
}

}  // namespace shiftmap
