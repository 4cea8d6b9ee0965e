// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/cli/context.h"
#include "proto/core/status.h"
#include "tools/experiment/chart.h"
#include "tools/experiment/result_table.h"

namespace shiftmap {

/// [{column: value, ...}, ...]; null for what is not finite.
Json RowsJson(const ResultTable& table);

/// The files of one experiment. With --dry-run nothing is written, and the paths are still listed.
class ExperimentOutput {
 public:
  /// Makes the folder, so that what cannot be written is told before hours of work and not after.
  /// Errors: MakeFolder()'s.
  /// @param name  Of the experiment: the stem of its files.
  static StatusOr<ExperimentOutput> Create(std::string name, std::string directory, bool dry_run);

  /// `<name>.csv`. Errors: kUnavailable. So have all below.
  Status WriteTable(const ResultTable& table);

  /// `<name>.md`: the table for people, under a title.
  Status WritePage(const std::string& title, const ResultTable& table);

  /// `<name>-<figure>.svg`.
  Status WriteFigure(const std::string& figure, const Chart& chart);

  /// The same from an SVG document.
  Status WritePicture(const std::string& figure, const std::string& svg);

  /// `<name>.json`: {"experiment", "version", "options", "rows": [{column: value, ...}, ...]}.
  /// Returns the document with the list of all files so far under "files", for the standard output.
  StatusOr<Json> WriteDocument(const Json& options, const ResultTable& table);

  /// Writes a table and its document, and reports them on the standard output.
  Status Report(const Json& options, const ResultTable& table, Context* context);

  /// The same for this and a second table, of another output: both are reported as one.
  Status ReportBoth(const Json& options,
                    const ResultTable& table,
                    const ResultTable& second,
                    ExperimentOutput* of_second,
                    Context* context);

  const std::vector<std::string>& files() const { return files_; }

 private:
  ExperimentOutput(std::string name, std::string directory, bool dry_run);

  Status Write(const std::string& file, const std::string& text);

  std::string name_;
  std::string directory_;
  bool dry_run_;
  std::vector<std::string> files_;
};

}  // namespace shiftmap
