// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/experiment_output.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "mapstore/cli/version.h"
#include "mapstore/core/atomic_file.h"
#include "mapstore/core/folder.h"

namespace shiftmap {
namespace {

Json RowJson(const std::vector<std::string>& columns, const std::vector<ResultTable::Cell>& row) {
  Json object = Json::object();
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const auto* number = std::get_if<double>(&row[i]);
    if (number == nullptr) {
      object[columns[i]] = std::get<std::string>(row[i]);
    } else {
      // JSON has no way to write what is not finite.
      object[columns[i]] = std::isfinite(*number) ? Json(*number) : Json(nullptr);
    }
  }
  return object;
}

}  // namespace

Json RowsJson(const ResultTable& table) {
  Json rows = Json::array();
  for (const auto& row : table.rows()) rows.push_back(RowJson(table.columns(), row));
  return rows;
}

StatusOr<ExperimentOutput> ExperimentOutput::Create(std::string name,
                                                    std::string directory,
                                                    bool dry_run) {
  if (!dry_run) SHIFTMAP_RETURN_IF_ERROR(MakeFolder(directory));
  return ExperimentOutput(std::move(name), std::move(directory), dry_run);
}

ExperimentOutput::ExperimentOutput(std::string name, std::string directory, bool dry_run)
    : name_(std::move(name)), directory_(std::move(directory)), dry_run_(dry_run) {}

Status ExperimentOutput::WriteTable(const ResultTable& table) {
  return Write(name_ + ".csv", table.ToCsv());
}

Status ExperimentOutput::WritePage(const std::string& title, const ResultTable& table) {
  return Write(name_ + ".md",
               fmt::format("# {}\n\nWritten by `shiftmap-experiment {}`; its options are in "
                           "`{}.json`.\n\n{}",
                           title,
                           name_,
                           name_,
                           table.ToMarkdown()));
}

Status ExperimentOutput::WriteFigure(const std::string& figure, const Chart& chart) {
  return WritePicture(figure, DrawChart(chart));
}

Status ExperimentOutput::WritePicture(const std::string& figure, const std::string& svg) {
  return Write(fmt::format("{}-{}.svg", name_, figure), svg);
}

StatusOr<Json> ExperimentOutput::WriteDocument(const Json& options, const ResultTable& table) {
  Json document = {{"experiment", name_},
                   {"version", SoftwareVersion()},
                   {"options", options},
                   {"rows", RowsJson(table)}};
  SHIFTMAP_RETURN_IF_ERROR(Write(name_ + ".json", JsonText(document)));
  document["files"] = files_;
  return document;
}

Status ExperimentOutput::Report(const Json& options, const ResultTable& table, Context* context) {
  SHIFTMAP_RETURN_IF_ERROR(WriteTable(table));
  SHIFTMAP_ASSIGN_OR_RETURN(const Json document, WriteDocument(options, table));
  context->Report(document, table.ToText());
  return OkStatus();
}

Status ExperimentOutput::ReportBoth(const Json& options,
                                    const ResultTable& table,
                                    const ResultTable& second,
                                    ExperimentOutput* of_second,
                                    Context* context) {
  SHIFTMAP_RETURN_IF_ERROR(WriteTable(table));
  SHIFTMAP_RETURN_IF_ERROR(of_second->WriteTable(second));
  SHIFTMAP_RETURN_IF_ERROR(of_second->WriteDocument(options, second).status());
  SHIFTMAP_ASSIGN_OR_RETURN(Json document, WriteDocument(options, table));
  for (const std::string& file : of_second->files()) document["files"].push_back(file);
  context->Report(document, table.ToText() + "\n" + second.ToText());
  return OkStatus();
}

Status ExperimentOutput::Write(const std::string& file, const std::string& text) {
  const std::string path = directory_ + "/" + file;
  files_.push_back(path);
  if (dry_run_) return OkStatus();
  return WriteFileAtomically(path, text);
}

}  // namespace shiftmap
