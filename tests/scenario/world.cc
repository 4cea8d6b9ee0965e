// SPDX-License-Identifier: Apache-2.0
#include "tests/scenario/world.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <sstream>

namespace shiftmap::testing {

World::World(const Arguments& options) {
  Arguments arguments = {"open", folder_.path()};
  arguments.insert(arguments.end(), options.begin(), options.end());
  RunForJson("shiftmap-sim", arguments);
}

Arguments World::BuildOf(const std::string& store, const std::vector<int>& runs) const {
  Arguments words = {"build", "--store", File(store), "--area", "floor"};
  for (const int run : runs) words.push_back(Log(run));
  return words;
}

std::string World::Name(int run) const { return folder_.File(fmt::format("run_{:03}", run)); }

std::vector<World::TrueMode> World::Modes(int run) const {
  const std::string name = fmt::format("run_{:03}", run);
  std::vector<TrueMode> modes;
  for (const std::vector<std::string>& row : ReadCsv(folder_.File("modes.csv"))) {
    if (row.at(0) == name) modes.push_back({row.at(1), std::stoi(row.at(2))});
  }
  return modes;
}

Arguments RestlessSite(int seed) {
  return {"--seed",
          std::to_string(seed),
          "--shifts",
          "4",
          "--groups",
          "20",
          "--modes",
          "3",
          "--mode-change-probability",
          "0.4",
          "--duration-s",
          "120"};
}

std::vector<std::vector<std::string>> ReadCsv(const std::string& path) {
  std::istringstream text(ReadFile(path));
  std::vector<std::vector<std::string>> rows;
  std::string line;
  std::getline(text, line);
  while (std::getline(text, line)) {
    std::vector<std::string>& row = rows.emplace_back();
    std::istringstream cells(line);
    for (std::string cell; std::getline(cells, cell, ',');) row.push_back(cell);
  }
  return rows;
}

}  // namespace shiftmap::testing
