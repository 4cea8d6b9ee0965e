// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <span>
#include <string_view>

#include "mapstore/core/csv.h"
#include "mapstore/core/input_file.h"
#include "mapstore/core/parse_whole.h"
#include "tools/eval/map_error.h"

namespace shiftmap {
namespace {

bool ParseNumber(const std::string& text, double* value) {
  *value = ParseWhole<double>(text).value_or(NAN);
  return std::isfinite(*value);
}

}  // namespace

StatusOr<std::vector<TruePlace>> ReadTruePlaces(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, ReadInputFile("truth", path));
  const StatusOr<std::vector<CsvRecord>> records = ParseCsv(text);
  if (!records.ok()) return InvalidArgument("truth '{}': {}", path, Message(records.status()));
  const std::vector<std::string> header =
      records->empty() ? std::vector<std::string>() : records->front().cells;
  const auto column = [&](std::string_view name) {
    return static_cast<std::size_t>(std::find(header.begin(), header.end(), name) - header.begin());
  };
  const std::size_t signature = column("signature");
  const std::size_t x = column("x_m");
  const std::size_t y = column("y_m");
  if (std::max({signature, x, y}) >= header.size()) {
    return InvalidArgument("truth '{}:1': expected columns signature, x_m and y_m", path);
  }
  std::vector<TruePlace> places;
  for (const auto& [line, cells] : std::span(*records).subspan(1)) {
    TruePlace place;
    if (cells.size() != header.size() || !ParseNumber(cells[x], &place.p_truth.x()) ||
        !ParseNumber(cells[y], &place.p_truth.y())) {
      return InvalidArgument(
          "truth '{}:{}': expected {} cells with numbers x_m and y_m", path, line, header.size());
    }
    place.signature = Signature(TextOfCsv(cells[signature]));
    places.push_back(std::move(place));
  }
  return places;
}

}  // namespace shiftmap
