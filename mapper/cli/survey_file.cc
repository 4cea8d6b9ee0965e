// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/survey_file.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <map>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "mapstore/core/csv.h"
#include "mapstore/core/input_file.h"
#include "mapstore/core/utf8.h"

namespace shiftmap {
namespace {

const std::vector<std::string> kHeader = {
    "signature", "mode", "x_m", "y_m", "sd_x_m", "sd_y_m", "probability"};
constexpr double kProbabilitySlack = 1e-9;
constexpr double kRounding = 1e-12;

struct SurveyRow : SurveyGroup::Row {
  Signature signature;
};

template <typename Number>
bool Parse(std::string_view field, Number* value) {
  const auto [end, error] = std::from_chars(field.data(), field.data() + field.size(), *value);
  return error == std::errc() && end == field.data() + field.size();
}

StatusOr<SurveyRow> ParseRow(const std::vector<std::string>& fields) {
  if (fields.size() != kHeader.size()) {
    return InvalidArgument("{} fields, expected {}", fields.size(), kHeader.size());
  }
  SurveyRow row;
  row.signature = Signature(TextOfCsv(fields[0]));
  if (row.signature.anonymous()) return InvalidArgument("empty signature");
  if (!IsUtf8(row.signature.text())) return InvalidArgument("signature is not UTF-8");
  ModeNumber::Value number = 0;
  if (!Parse(fields[1], &number) || number < 0)
    return InvalidArgument("mode '{}', expected 0 or more", fields[1]);
  row.mode.number = ModeNumber(number);
  if (!Parse(fields[6], &row.probability) || !(row.probability >= 0.0 && row.probability <= 1.0)) {
    return InvalidArgument("probability '{}', expected 0 to 1", fields[6]);
  }
  if (row.mode.number == kAbsent) return row;
  Eigen::Vector2d sd;
  if (!Parse(fields[2], &row.mode.p_map_landmark.x()) ||
      !Parse(fields[3], &row.mode.p_map_landmark.y()) || !row.mode.p_map_landmark.allFinite()) {
    return InvalidArgument("position '{},{}', expected two numbers", fields[2], fields[3]);
  }
  if (!Parse(fields[4], &sd.x()) || !Parse(fields[5], &sd.y()) || !sd.allFinite() ||
      sd.minCoeff() <= 0.0) {
    return InvalidArgument(
        "standard deviation '{},{}', expected two positive numbers", fields[4], fields[5]);
  }
  row.mode.cov_p_map_landmark = sd.cwiseAbs2().asDiagonal();
  return row;
}

StatusOr<LandmarkGroup> MakeGroup(const Signature& signature, const SurveyGroup& survey) {
  LandmarkGroup group;
  group.signature = signature;
  std::vector<double> probabilities{0.0};
  double sum = 0.0;
  for (const auto& [number, row] : survey.rows) {
    sum += row.probability;
    if (number == kAbsent) continue;
    group.modes.push_back(row.mode);
    probabilities.push_back(row.probability);
  }
  if (group.modes.empty())
    return InvalidArgument("landmark '{}': no mode with a position", signature.text());
  if (!(sum <= 1.0 + kProbabilitySlack)) {
    return InvalidArgument(
        "landmark '{}': probabilities sum to {}, expected 1 at most", signature.text(), sum);
  }
  const auto absent = survey.rows.find(kAbsent);
  probabilities[0] =
      (absent == survey.rows.end() ? 0.0 : absent->second.probability) + std::max(0.0, 1.0 - sum);
  group.probabilities = Eigen::Map<const Eigen::VectorXd>(
      probabilities.data(), static_cast<Eigen::Index>(probabilities.size()));
  // Else they stay as they are, to the last bit.
  if (sum > 1.0 + kRounding) group.probabilities /= group.probabilities.sum();
  group.chain = ModeChain::Uniform(static_cast<int>(group.modes.size()), survey.leave_rate_per_s);
  return group;
}

// The rows of each landmark.
StatusOr<std::map<Signature, SurveyGroup>> ParseGroups(const std::string& path,
                                                       std::string_view text,
                                                       double leave_rate_per_s) {
  const StatusOr<std::vector<CsvRecord>> records = ParseCsv(text);
  if (!records.ok()) return InvalidArgument("survey '{}': {}", path, Message(records.status()));
  if (records->empty() || records->front().cells != kHeader) {
    return InvalidArgument("{}:1: expected the header '{}'", path, fmt::join(kHeader, ","));
  }
  std::map<Signature, SurveyGroup> groups;
  for (const CsvRecord& record : std::span(*records).subspan(1)) {
    StatusOr<SurveyRow> row = ParseRow(record.cells);
    if (!row.ok()) return InvalidArgument("{}:{}: {}", path, record.line, Message(row.status()));
    SurveyGroup& group = groups[row->signature];
    group.leave_rate_per_s = leave_rate_per_s;
    if (const Status added = group.Add(*row); !added.ok()) {
      return InvalidArgument(
          "{}:{}: landmark '{}': {}", path, record.line, row->signature.text(), Message(added));
    }
  }
  return groups;
}

}  // namespace

Status SurveyGroup::Add(const Row& row) {
  if (!rows.emplace(row.mode.number, row).second) {
    return InvalidArgument("mode {} is given twice", row.mode.number.value());
  }
  if (rows.size() - rows.count(kAbsent) > kMaxSurveyModes) {
    return InvalidArgument("more than {} modes", kMaxSurveyModes);
  }
  return OkStatus();
}

StatusOr<MapContent> MakeSurveyMap(const std::map<Signature, SurveyGroup>& groups,
                                   Stamp stamp,
                                   std::vector<Mode> anonymous_landmarks) {
  MapContent content;
  content.stamp = stamp;
  std::vector<Eigen::Matrix2d> diagonal;
  for (const auto& [signature, survey] : groups) {
    SHIFTMAP_ASSIGN_OR_RETURN(LandmarkGroup group, MakeGroup(signature, survey));
    for (const Mode& mode : group.modes) diagonal.push_back(mode.cov_p_map_landmark);
    content.groups.push_back(std::move(group));
  }
  content.covariance = JointCovariance(std::move(diagonal), {});
  content.anonymous_landmarks = std::move(anonymous_landmarks);
  SHIFTMAP_RETURN_IF_ERROR(ValidateMapContent(content));
  return content;
}

StatusOr<MapContent> ReadSurvey(const std::string& path, Stamp stamp, double leave_rate_per_s) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, ReadInputFile("survey", path));
  const StatusOr<std::map<Signature, SurveyGroup>> groups =
      ParseGroups(path, text, leave_rate_per_s);
  SHIFTMAP_RETURN_IF_ERROR(groups.status());
  if (groups->empty()) return InvalidArgument("survey '{}': no landmarks", path);
  StatusOr<MapContent> content = MakeSurveyMap(*groups, stamp);
  if (content.ok()) return content;
  return InvalidArgument("survey '{}': {}", path, Message(content.status()));
}

}  // namespace shiftmap
