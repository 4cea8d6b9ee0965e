// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/papers_results.h"

#include <algorithm>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <utility>

#include "mapstore/core/input_file.h"

namespace shiftmap {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

using Members = std::vector<std::pair<std::string, ResultTable::Cell>>;

Json CellJson(const ResultTable::Cell& cell) {
  return std::visit([](const auto& value) { return Json(value); }, cell);
}

std::string CellText(const ResultTable::Cell& cell) {
  return std::visit([](const auto& value) { return fmt::format("{}", value); }, cell);
}

// "delta_m 1, method mcts"
std::string TextOf(const Members& members) {
  std::string text;
  for (const auto& [name, cell] : members) {
    if (!text.empty()) text += ", ";
    text += name + " " + CellText(cell);
  }
  return text;
}

bool HasMembers(const Json& object, const Members& members) {
  return object.is_object() && std::ranges::all_of(members, [&](const auto& member) {
           const auto found = object.find(member.first);
           return found != object.end() && *found == CellJson(member.second);
         });
}

StatusOr<Json> ReadDocument(const PaperRun& run, const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, ReadInputFile("result", path));
  Json document = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  const Members experiment = {{"experiment", run.Experiment()}};
  if (document.is_discarded() || !HasMembers(document, experiment) ||
      !document.value("version", Json()).is_string()) {
    return InvalidArgument("result '{}': no document of '{}'", path, run.Experiment());
  }
  if (!run.options.empty() && !HasMembers(document.value("options", Json()), run.options)) {
    return InvalidArgument("result '{}': expected the options {}", path, TextOf(run.options));
  }
  return document;
}

// The rows' array, or null.
const Json* RowsOf(const Json& document, const std::string& pointer) {
  const Json::json_pointer at(pointer);
  return document.contains(at) && document[at].is_array() ? &document[at] : nullptr;
}

StatusOr<double> NumberOf(const Json& row, const std::string& member) {
  const auto found = row.find(member);
  if (found == row.end()) return NotFound("no '{}'", member);
  if (found->is_null()) return kNone;
  if (!found->is_number()) return NotFound("'{}' is no number", member);
  return found->get<double>();
}

// What is taken of one array.
struct Taken {
  std::vector<const PaperValue*> values;
  std::set<std::string> members;
};

Json CondensedRows(const Json& rows, const Taken& taken) {
  Json condensed = Json::array();
  for (const Json& row : rows) {
    if (std::ranges::none_of(
            taken.values, [&](const PaperValue* value) { return HasMembers(row, value->row); })) {
      continue;
    }
    Json& kept = condensed.emplace_back(Json::object());
    for (const auto& [name, member] : row.items()) {
      if (taken.members.contains(name)) kept[name] = member;
    }
  }
  return condensed;
}

std::map<std::string, Taken> TakenOf(const std::string& run, const PapersCatalogue& catalogue) {
  std::map<std::string, Taken> arrays;
  for (const Paper& paper : catalogue.papers) {
    for (const PaperSection& section : paper.sections) {
      for (const PaperItem& item : section.items) {
        for (const PaperValue& value : item.values) {
          if (value.run != run) continue;
          Taken& taken = arrays[value.rows];
          taken.values.push_back(&value);
          for (const auto& [name, cell] : value.row) taken.members.insert(name);
          taken.members.insert({value.value, value.error});
        }
      }
    }
  }
  return arrays;
}

Json WithoutArrays(const Json& object) {
  Json kept = Json::object();
  for (const auto& [name, member] : object.items()) {
    if (!member.is_array()) kept[name] = member.is_object() ? WithoutArrays(member) : member;
  }
  return kept;
}

}  // namespace

StatusOr<PaperDocuments> ReadPaperDocuments(const PapersCatalogue& catalogue,
                                            const std::vector<std::string>& folders) {
  for (const std::string& folder : folders) {
    if (!std::filesystem::is_directory(folder)) return NotFound("results '{}': no folder", folder);
  }
  PaperDocuments documents;
  for (const PaperRun& run : catalogue.runs) {
    for (const std::string& folder : folders) {
      const std::string path = fmt::format("{}/{}/{}.json", folder, run.name, run.Experiment());
      if (!std::filesystem::exists(path)) continue;
      SHIFTMAP_ASSIGN_OR_RETURN(documents[run.name], ReadDocument(run, path));
      break;
    }
  }
  return documents;
}

StatusOr<PaperNumber> FindPaperNumber(const Json& document, const PaperValue& value) {
  const Json* rows = RowsOf(document, value.rows);
  if (rows == nullptr) return NotFound("run '{}': no array '{}'", value.run, value.rows);
  std::vector<const Json*> found;
  for (const Json& row : *rows) {
    if (HasMembers(row, value.row)) found.push_back(&row);
  }
  const std::string what =
      fmt::format("run '{}', '{}' with {}", value.run, value.rows, TextOf(value.row));
  if (found.size() != 1) return NotFound("{}: {} rows, expected 1", what, found.size());
  PaperNumber number{kNone, kNone};
  const auto take = [&](const std::string& member, double* into) -> Status {
    const StatusOr<double> taken = NumberOf(*found.front(), member);
    if (!taken.ok()) return NotFound("{}: {}", what, Message(taken.status()));
    *into = *taken;
    return OkStatus();
  };
  SHIFTMAP_RETURN_IF_ERROR(take(value.value, &number.value));
  if (!value.error.empty()) SHIFTMAP_RETURN_IF_ERROR(take(value.error, &number.error));
  return number;
}

Json CondensedDocument(const Json& document,
                       const std::string& run,
                       const PapersCatalogue& catalogue) {
  Json condensed = WithoutArrays(document);
  for (const auto& [pointer, taken] : TakenOf(run, catalogue)) {
    condensed[Json::json_pointer(pointer)] = CondensedRows(*RowsOf(document, pointer), taken);
  }
  return condensed;
}

}  // namespace shiftmap
