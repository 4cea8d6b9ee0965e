// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/csv_run.h"

#include <functional>
#include <map>
#include <optional>
#include <string_view>
#include <utility>

#include "mapstore/core/csv.h"
#include "mapstore/core/input_file.h"
#include "tools/convert/decimal.h"

namespace shiftmap {
namespace {

using Names = std::vector<std::string>;

std::string_view Trim(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r";
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) + 1 - begin);
}

// The columns of a table by their names.
class Columns {
 public:
  static StatusOr<Columns> Of(const Names& cells) {
    Columns columns;
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const std::string name(Trim(cells[i]));
      if (!columns.index_.emplace(name, i).second) return InvalidArgument("two columns '{}'", name);
    }
    columns.count_ = cells.size();
    return columns;
  }

  std::size_t count() const { return count_; }
  bool Has(const std::string& name) const { return index_.count(name) > 0; }
  std::size_t At(const std::string& name) const { return index_.at(name); }

  Status Require(const Names& names) const {
    std::string missing;
    for (const std::string& name : names) {
      if (!Has(name)) missing += (missing.empty() ? "'" : ", '") + name + "'";
    }
    if (missing.empty()) return OkStatus();
    return InvalidArgument("no column {}, there are {}", missing, All());
  }

  std::string All() const {
    std::string all;
    for (const auto& [name, index] : index_) all += (all.empty() ? "'" : ", '") + name + "'";
    return all;
  }

  void NoteIgnored(const std::string& path, const Names& known, Names* ignored) const {
    for (const auto& [name, index] : index_) {
      bool is_known = false;
      for (const std::string& other : known) is_known = is_known || other == name;
      if (!is_known) ignored->push_back(fmt::format("{}: column '{}'", path, name));
    }
  }

 private:
  std::map<std::string, std::size_t> index_;
  std::size_t count_ = 0;
};

// One row of a table.
class Row {
 public:
  Row(const Columns& columns, const Names& cells) : columns_(columns), cells_(cells) {}

  std::string_view Cell(const std::string& name) const { return Trim(cells_[columns_.At(name)]); }
  std::string Text(const std::string& name) const { return TextOfCsv(cells_[columns_.At(name)]); }
  StatusOr<double> Number(const std::string& name) const {
    const auto number = ParseNumber(Cell(name));
    if (number.ok()) return number;
    return InvalidArgument("column '{}': {}", name, Message(number.status()));
  }

  /// Errors also: kInvalidArgument if it is before the stamp of the row before.
  StatusOr<Stamp> NextStamp(std::optional<Stamp>* last) const {
    const auto stamp = ParseStamp(Cell("stamp_s"));
    if (!stamp.ok()) return InvalidArgument("column 'stamp_s': {}", Message(stamp.status()));
    if (*last && *stamp < **last) {
      return InvalidArgument(
          "time {} goes backwards from {:.6f}", Cell("stamp_s"), ToSecondsSinceEpoch(**last));
    }
    *last = *stamp;
    return stamp;
  }

 private:
  const Columns& columns_;
  const Names& cells_;
};

using TakeHeader = std::function<Status(const Columns&)>;
using TakeRow = std::function<Status(const Row&)>;

// Reads a table line by line, so that a large one takes no more than its text.
Status ForEachCsvRow(const std::string& path, const TakeHeader& take_header, const TakeRow& take) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, ReadInputFile("file", path));
  std::optional<Columns> columns;
  const auto take_line = [&](std::string_view line) -> Status {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<CsvRecord> records, ParseCsv(line));
    if (records.empty()) return OkStatus();
    const Names& cells = records.front().cells;
    if (!columns) {
      SHIFTMAP_ASSIGN_OR_RETURN(columns, Columns::Of(cells));
      return take_header(*columns);
    }
    if (cells.size() != columns->count()) {
      return InvalidArgument("{} cells, expected {}", cells.size(), columns->count());
    }
    return take(Row(*columns, cells));
  };
  std::string_view rest = text;
  std::string_view line;
  for (std::size_t number = 1; TakeLine(&rest, &line); ++number) {
    if (const Status status = take_line(line); !status.ok()) {
      std::string message = Message(status);
      // The parser counts the lines of what it is given.
      constexpr std::string_view kFirstLine = "line 1: ";
      if (message.starts_with(kFirstLine)) message.erase(0, kFirstLine.size());
      return MakeStatus(status.code(), "{}:{}: {}", path, number, message);
    }
  }
  if (!columns) return InvalidArgument("file '{}': no row of names", path);
  return OkStatus();
}

Status ReadOdometry(const std::string& path, CsvRun* out) {
  const Names known = {"stamp_s", "v_mps", "omega_radps"};
  std::optional<Stamp> last;
  const auto take = [&](const Row& row) -> Status {
    OdometrySample sample;
    SHIFTMAP_ASSIGN_OR_RETURN(sample.stamp, row.NextStamp(&last));
    SHIFTMAP_ASSIGN_OR_RETURN(sample.v_mps, row.Number("v_mps"));
    SHIFTMAP_ASSIGN_OR_RETURN(sample.omega_radps, row.Number("omega_radps"));
    SHIFTMAP_RETURN_IF_ERROR(ValidateEvent(sample));
    out->run.odometry.push_back(sample);
    return OkStatus();
  };
  const auto take_header = [&](const Columns& columns) {
    columns.NoteIgnored(path, known, &out->ignored_columns);
    return columns.Require(known);
  };
  SHIFTMAP_RETURN_IF_ERROR(ForEachCsvRow(path, take_header, take));
  if (out->run.odometry.empty()) return InvalidArgument("file '{}': no odometry", path);
  return OkStatus();
}

// Which two columns a measurement is in, and which two its noise.
struct MeasurementColumns {
  Observation::Kind kind = Observation::Kind::kRangeBearing;
  Names z;
  Names sd;  // Empty without.
};

StatusOr<MeasurementColumns> ChooseMeasurement(const Columns& columns) {
  const MeasurementColumns polar = {Observation::Kind::kRangeBearing,
                                    {"range_m", "bearing_rad"},
                                    {"sd_range_m", "sd_bearing_rad"}};
  const MeasurementColumns cartesian = {
      Observation::Kind::kCartesian, {"x_m", "y_m"}, {"sd_x_m", "sd_y_m"}};
  const auto has_any = [&](const Names& names) {
    return columns.Has(names[0]) || columns.Has(names[1]);
  };
  if (has_any(polar.z) == has_any(cartesian.z)) {
    return InvalidArgument(
        "expected either columns 'range_m', 'bearing_rad' or columns 'x_m', 'y_m', there are {}",
        columns.All());
  }
  MeasurementColumns chosen = has_any(polar.z) ? polar : cartesian;
  SHIFTMAP_RETURN_IF_ERROR(columns.Require(chosen.z));
  if (has_any(chosen.sd)) {
    SHIFTMAP_RETURN_IF_ERROR(columns.Require(chosen.sd));
  } else {
    chosen.sd.clear();
  }
  return chosen;
}

StatusOr<Observation> ReadObservation(const Row& row, const MeasurementColumns& columns) {
  Observation observation;
  observation.signature = Signature(row.Text("signature"));
  observation.kind = columns.kind;
  SHIFTMAP_ASSIGN_OR_RETURN(observation.z.x(), row.Number(columns.z[0]));
  SHIFTMAP_ASSIGN_OR_RETURN(observation.z.y(), row.Number(columns.z[1]));
  if (columns.sd.empty()) return observation;
  if (row.Cell(columns.sd[0]).empty() && row.Cell(columns.sd[1]).empty()) return observation;
  Eigen::Vector2d sd;
  for (Eigen::Index i = 0; i < 2; ++i) {
    const std::string& name = columns.sd[static_cast<std::size_t>(i)];
    SHIFTMAP_ASSIGN_OR_RETURN(sd(i), row.Number(name));
    if (!(sd(i) > 0.0)) {
      return InvalidArgument("column '{}': {}, expected above 0", name, sd(i));
    }
  }
  observation.cov_z = sd.cwiseAbs2().asDiagonal();
  return observation;
}

Status ReadObservations(const std::string& path, CsvRun* out) {
  std::vector<Scan>& scans = out->run.scans;
  MeasurementColumns measurement;
  const auto take_header = [&](const Columns& columns) -> Status {
    SHIFTMAP_RETURN_IF_ERROR(columns.Require({"stamp_s", "signature"}));
    SHIFTMAP_ASSIGN_OR_RETURN(measurement, ChooseMeasurement(columns));
    Names known = {"stamp_s", "signature"};
    known.insert(known.end(), measurement.z.begin(), measurement.z.end());
    known.insert(known.end(), measurement.sd.begin(), measurement.sd.end());
    columns.NoteIgnored(path, known, &out->ignored_columns);
    return OkStatus();
  };
  std::optional<Stamp> last;
  const auto take = [&](const Row& row) -> Status {
    SHIFTMAP_ASSIGN_OR_RETURN(const Stamp stamp, row.NextStamp(&last));
    if (scans.empty() || scans.back().stamp != stamp) {
      scans.push_back({.stamp = stamp, .observations = {}});
    }
    const bool nothing = row.Cell("signature").empty() && row.Cell(measurement.z[0]).empty() &&
                         row.Cell(measurement.z[1]).empty();
    if (nothing) return OkStatus();
    SHIFTMAP_ASSIGN_OR_RETURN(Observation observation, ReadObservation(row, measurement));
    SHIFTMAP_RETURN_IF_ERROR(ValidateEvent(Scan{stamp, {observation}}));
    scans.back().observations.push_back(std::move(observation));
    return OkStatus();
  };
  return ForEachCsvRow(path, take_header, take);
}

Status ReadTruth(const std::string& path, CsvRun* out) {
  const Names known = {"stamp_s", "x_m", "y_m", "yaw_rad"};
  std::optional<Stamp> last;
  const auto take_header = [&](const Columns& columns) {
    columns.NoteIgnored(path, known, &out->ignored_columns);
    return columns.Require(known);
  };
  return ForEachCsvRow(path, take_header, [&](const Row& row) -> Status {
    SHIFTMAP_ASSIGN_OR_RETURN(const Stamp stamp, row.NextStamp(&last));
    SHIFTMAP_ASSIGN_OR_RETURN(const double x_m, row.Number("x_m"));
    SHIFTMAP_ASSIGN_OR_RETURN(const double y_m, row.Number("y_m"));
    SHIFTMAP_ASSIGN_OR_RETURN(const double yaw_rad, row.Number("yaw_rad"));
    out->truth.push_back({stamp, Se2(x_m, y_m, yaw_rad)});
    return OkStatus();
  });
}

}  // namespace

StatusOr<CsvRun> ReadCsvRun(const CsvRunOptions& options) {
  CsvRun out;
  out.run.info = options.info;
  SHIFTMAP_RETURN_IF_ERROR(ReadOdometry(options.odometry, &out));
  SHIFTMAP_RETURN_IF_ERROR(ReadObservations(options.observations, &out));
  if (!options.truth.empty()) SHIFTMAP_RETURN_IF_ERROR(ReadTruth(options.truth, &out));
  return out;
}

}  // namespace shiftmap
