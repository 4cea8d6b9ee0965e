// SPDX-License-Identifier: Apache-2.0
//
// Makes a seed corpus for shiftmap_store_file_fuzz: shiftmap_store_file_seeds FOLDER
#include <filesystem>
#include <fstream>
#include <random>
#include <string>

namespace {

void Write(const std::filesystem::path& folder, const std::string& name, const std::string& bytes) {
  std::ofstream(folder / name, std::ios::binary) << bytes;
}

char Byte(int value) { return static_cast<char>(value); }

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const std::filesystem::path folder = argv[1];
  std::filesystem::create_directories(folder);
  std::mt19937_64 random(1);
  Write(folder, "empty", "");
  Write(folder, "magic", Byte(0) + std::string("SQLite format 3") + std::string(200, '\0'));
  Write(folder, "unchanged", std::string(1, Byte(2)));
  for (int i = 0; i < 200; ++i) {
    std::string patch(1, Byte(i % 2 == 0 ? 1 : 5));
    for (int j = 0; j < 1 + i % 3; ++j) {
      for (int k = 0; k < 4 + 8; ++k) patch += Byte(static_cast<int>(random() % 256));
      patch[patch.size() - 12] = Byte(0 + static_cast<int>(random() % 4));
    }
    Write(folder, "patch-" + std::to_string(i), patch);
  }
  // One value of every kind for every column.
  for (int column = 0; column < 160; ++column) {
    for (int kind = 0; kind < 4; ++kind) {
      std::string edit = {Byte(random() % 2 == 0 ? 2 : 6),
                          Byte(column),
                          Byte(static_cast<int>(random() % 8)),
                          Byte(kind)};
      if (kind == 2) edit += Byte(8);
      if (kind == 3) edit += Byte(static_cast<int>(random() % 4));
      for (int i = 0; i < 8; ++i)
        edit += Byte(i < 6 && kind == 0 ? 0 : static_cast<int>(random() % 256));
      Write(folder, "edit-" + std::to_string(column) + "-" + std::to_string(kind), edit);
    }
  }
  return 0;
}
