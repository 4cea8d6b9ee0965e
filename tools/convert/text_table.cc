// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/text_table.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "mapstore/core/input_file.h"

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
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, ReadInputFile("file", path));
  std::string_view rest = text;
  std::string_view line;
  TextRow row;
  const std::string between = std::string(kBlanks) + std::string(separators);
  for (std::size_t number = 1; TakeLine(&rest, &line); ++number) {
    Split(line, between, &row);
    if (row.empty() || row.front().starts_with('#')) continue;
    if (columns != kAnyColumns && row.size() != columns) {
      return InvalidArgument("{}:{}: {} fields, expected {}", path, number, row.size(), columns);
    }
    SHIFTMAP_RETURN_IF_ERROR(Annotate(take(row), "{}:{}", path, number));
  }
  return OkStatus();
}

std::string FileIn(const std::string& folder, const std::string& name) {
  return (std::filesystem::path(folder) / name).string();
}

Status CheckFolder(const char* what, const std::string& folder) {
  std::error_code error;
  if (std::filesystem::is_directory(folder, error)) return OkStatus();
  return NotFound("{} '{}': no such folder", what, folder);
}

}  // namespace shiftmap
