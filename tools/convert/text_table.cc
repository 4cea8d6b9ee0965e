// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/text_table.h"

#include <algorithm>
#include <filesystem>
#include <fstream>

namespace shiftmap {
namespace {

constexpr std::string_view kBlanks = " \t\r";

void Split(std::string_view line, std::string_view between, TextRow* row) {
  row->clear();
  for (std::size_t begin = line.find_first_not_of(between); begin != std::string_view::npos;) {
    const std::size_t end = std::min(line.find_first_of(between, begin), line.size());
    row->push_back(line.substr(begin, end - begin));
    begin = line.find_first_not_of(between, end);
  }
}

}  // namespace

Status ForEachRow(const std::string& path,
                  std::size_t columns,
                  const std::function<Status(const TextRow&)>& take,
                  std::string_view separators) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return NotFound("file '{}': does not exist", path);
  if (!std::filesystem::is_regular_file(path, error)) {
    return InvalidArgument("file '{}': not a regular file", path);
  }
  std::ifstream file(path);
  if (!file) return Unavailable("file '{}': cannot be opened for reading", path);
  std::string line;
  TextRow row;
  const std::string between = std::string(kBlanks) + std::string(separators);
  for (std::size_t number = 1; std::getline(file, line); ++number) {
    Split(line, between, &row);
    if (row.empty() || row.front().starts_with('#')) continue;
    if (row.size() != columns) {
      return InvalidArgument("{}:{}: {} fields, expected {}", path, number, row.size(), columns);
    }
    if (const Status status = take(row); !status.ok()) {
      return MakeStatus(status.code(), "{}:{}: {}", path, number, Message(status));
    }
  }
  if (file.bad()) return Unavailable("file '{}': cannot be read", path);
  return OkStatus();
}

}  // namespace shiftmap
