// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/recurring_data.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <string_view>

#include "mapstore/core/day.h"
#include "mapstore/core/input_file.h"
#include "mapstore/core/parse_whole.h"

namespace shiftmap {
namespace {

// Probability that a visit shows another state than the true one; as good as exact.
constexpr double kWrong = 1e-9;

StatusOr<std::vector<std::string>> ReadLines(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, ReadInputFile("record", path));
  std::vector<std::string> lines;
  std::string_view rest = text;
  for (std::string_view line; TakeLine(&rest, &line);) lines.emplace_back(line);
  return lines;
}

// The whole of `text` as an integer.
bool ParseInteger(std::string_view text, std::int64_t* value) {
  if (!text.empty() && text.back() == '\r') text.remove_suffix(1);
  const std::optional<std::int64_t> number = ParseWhole<std::int64_t>(text);
  *value = number.value_or(0);
  return number.has_value();
}

}  // namespace

StatusOr<RecurringRecord> ReadDoorRecord(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<std::string> lines, ReadLines(path));
  RecurringRecord record{"door", 2, {}, {}};
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const std::string_view line = lines[i];
    const std::size_t space = line.find(' ');
    std::int64_t seconds = 0;
    std::int64_t open = 0;
    if (space == std::string_view::npos || !ParseInteger(line.substr(0, space), &seconds) ||
        !ParseInteger(line.substr(space + 1), &open) || open < 0 || open > 1) {
      return InvalidArgument(
          "record '{}': line {}: '{}', expected 'unix_time 0|1'", path, i + 1, line);
    }
    const Stamp stamp = StampFromSeconds(static_cast<double>(seconds));
    if (!record.stamps.empty() && stamp <= record.stamps.back()) {
      return InvalidArgument("record '{}': line {}: time {} does not ascend", path, i + 1, seconds);
    }
    record.stamps.push_back(stamp);
    record.values.push_back(static_cast<int>(open));
  }
  return record;
}

StatusOr<RecurringRecord> ReadRoomRecord(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<std::string> lines, ReadLines(path));
  RecurringRecord record{"rooms", 0, {}, {}};
  for (std::size_t i = 0; i < lines.size(); ++i) {
    std::int64_t room = 0;
    if (!ParseInteger(lines[i], &room) || room < 0 || room > 100) {
      return InvalidArgument(
          "record '{}': line {}: '{}', expected a room's number", path, i + 1, lines[i]);
    }
    if (room == 0) continue;
    record.stamps.push_back(StampFromSeconds(60.0 * static_cast<double>(i)));
    record.values.push_back(static_cast<int>(room) - 1);
    record.states = std::max(record.states, static_cast<int>(room));
  }
  return record;
}

ChainHistory VisitRecord(const RecurringRecord& record, const std::vector<std::size_t>& indices) {
  ChainHistory history{Signature(record.name), record.states, {}};
  history.visits.reserve(indices.size());
  for (const std::size_t i : indices) {
    Eigen::VectorXd values = Eigen::VectorXd::Constant(record.states, std::log(kWrong));
    values(record.values[i]) = 0.0;
    history.visits.push_back({record.stamps[i], record.stamps[i], values});
  }
  return history;
}

std::vector<std::size_t> SpacedVisits(const RecurringRecord& record,
                                      std::size_t begin,
                                      std::size_t end,
                                      const VisitSpacing& spacing,
                                      std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> log_gap(std::log(60.0), std::log(kSecondsPerDay));
  std::vector<std::size_t> indices;
  for (std::size_t i = begin; i < end;) {
    indices.push_back(i);
    const double gap_s = spacing.gap_s > 0.0 ? spacing.gap_s : std::exp(log_gap(random));
    const auto next = std::lower_bound(
        record.stamps.begin(), record.stamps.end(), record.stamps[i] + FromSeconds(gap_s));
    i = static_cast<std::size_t>(next - record.stamps.begin());
  }
  return indices;
}

}  // namespace shiftmap
