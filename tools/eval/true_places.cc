// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <string_view>

#include "tools/eval/map_error.h"

namespace shiftmap {
namespace {

std::vector<std::string> SplitCells(const std::string& line) {
  std::vector<std::string> cells(1);
  for (const char c : line) {
    if (c == ',') {
      cells.emplace_back();
    } else if (c != '\r') {
      cells.back() += c;
    }
  }
  return cells;
}

bool ParseNumber(const std::string& text, double* value) {
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, *value);
  return error == std::errc() && stop == end && std::isfinite(*value);
}

}  // namespace

StatusOr<std::vector<TruePlace>> ReadTruePlaces(const std::string& path) {
  std::ifstream file(path);
  if (!file) return NotFound("truth '{}': cannot be opened", path);
  std::string line;
  std::getline(file, line);
  const std::vector<std::string> header = SplitCells(line);
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
  for (int number = 2; std::getline(file, line); ++number) {
    if (line.empty() || line == "\r") continue;
    const std::vector<std::string> cells = SplitCells(line);
    TruePlace place;
    if (cells.size() != header.size() || !ParseNumber(cells[x], &place.p_truth.x()) ||
        !ParseNumber(cells[y], &place.p_truth.y())) {
      return InvalidArgument(
          "truth '{}:{}': expected {} cells with numbers x_m and y_m", path, number, header.size());
    }
    place.signature = Signature(cells[signature]);
    places.push_back(std::move(place));
  }
  return places;
}

}  // namespace shiftmap
