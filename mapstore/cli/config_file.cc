// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/config_file.h"

#include <toml++/toml.h>

#include <algorithm>
#include <optional>

#include "mapstore/core/input_file.h"

namespace shiftmap {
namespace {

// Options take some kilobytes.
constexpr std::size_t kMaxConfigBytes = std::size_t{1} << 20;

std::optional<std::string> ScalarText(const toml::node& node) {
  if (const auto text = node.value_exact<std::string>()) return *text;
  if (const auto flag = node.value_exact<bool>()) return *flag ? "true" : "false";
  if (const auto integer = node.value_exact<std::int64_t>()) return fmt::format("{}", *integer);
  if (const auto number = node.value_exact<double>()) return fmt::format("{}", *number);
  return std::nullopt;
}

Status AppendEntry(const std::string& path,
                   const std::string& section,
                   std::string_view key,
                   const toml::node& node,
                   std::vector<ConfigEntry>* entries) {
  ConfigEntry entry{section, std::string(key), {}, static_cast<int>(node.source().begin.line)};
  std::replace(entry.key.begin(), entry.key.end(), '_', '-');
  bool readable = true;
  const auto append = [&](const toml::node& item) {
    const std::optional<std::string> text = ScalarText(item);
    readable = readable && text.has_value();
    entry.values.push_back(text.value_or(""));
  };
  if (const toml::array* array = node.as_array()) {
    for (const toml::node& item : *array) append(item);
  } else {
    append(node);
  }
  if (!readable) {
    return InvalidArgument(
        "config '{}:{}': key '{}': expected a string, number, boolean or an array of them",
        path,
        node.source().begin.line,
        std::string(key));
  }
  entries->push_back(std::move(entry));
  return OkStatus();
}

// @param depth  How many tables may be inside.
Status AppendTable(const std::string& path,
                   const std::string& section,
                   const toml::table& table,
                   int depth,
                   std::vector<ConfigEntry>* entries) {
  for (const auto& [key, node] : table) {
    const toml::table* const inner = depth > 0 ? node.as_table() : nullptr;
    if (inner == nullptr) {
      SHIFTMAP_RETURN_IF_ERROR(AppendEntry(path, section, key.str(), node, entries));
      continue;
    }
    const std::string name = section.empty() ? "" : section + ".";
    SHIFTMAP_RETURN_IF_ERROR(
        AppendTable(path, name + std::string(key.str()), *inner, depth - 1, entries));
  }
  return OkStatus();
}

}  // namespace

StatusOr<std::vector<ConfigEntry>> ReadConfigFile(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, ReadInputFile("config", path, kMaxConfigBytes));
  toml::table root;
  try {
    root = toml::parse(text, path);
  } catch (const toml::parse_error& error) {
    return InvalidArgument(
        "config '{}:{}': {}", path, error.source().begin.line, std::string(error.description()));
  }
  std::vector<ConfigEntry> entries;
  SHIFTMAP_RETURN_IF_ERROR(AppendTable(path, "", root, 2, &entries));
  return entries;
}

}  // namespace shiftmap
