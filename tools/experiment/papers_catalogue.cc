// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/papers_catalogue.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <nlohmann/json.hpp>
#include <set>

#include "mapstore/core/input_file.h"

namespace shiftmap {
namespace {

using Json = nlohmann::ordered_json;
using Members = std::vector<std::pair<std::string, ResultTable::Cell>>;

constexpr std::array kStatuses = {
    PaperStatus::kAsPrinted, PaperStatus::kDiffers, PaperStatus::kNotDone};

// Takes the members of a JSON object. Of what is wrong with them the first is kept.
class ObjectReader {
 public:
  ObjectReader(const Json& object, std::string name) : object_(object), name_(std::move(name)) {
    if (!object.is_object()) Fail("is no object");
  }

  std::string Text(const char* key) {
    const Json* value = Find(key);
    if (value == nullptr) {
      Fail(fmt::format("no '{}'", key));
      return {};
    }
    return TextOf(*value, key);
  }

  std::string TextOr(const char* key, const std::string& otherwise) {
    const Json* value = Find(key);
    return value == nullptr ? otherwise : TextOf(*value, key);
  }

  // Those of an array; none if it is missing.
  std::vector<Json> Array(const char* key) {
    const Json* value = Find(key);
    if (value == nullptr) return {};
    if (!value->is_array()) Fail(fmt::format("'{}' is no array", key));
    return {value->begin(), value->end()};
  }

  Members Cells(const char* key) {
    Members cells;
    const Json* value = Find(key);
    if (value == nullptr) return cells;
    for (const auto& [name, member] : value->items()) {
      if (member.is_number()) cells.emplace_back(name, member.get<double>());
      if (member.is_string()) cells.emplace_back(name, member.get<std::string>());
    }
    if (cells.size() != value->size()) Fail(fmt::format("'{}' has no number or text", key));
    return cells;
  }

  void Fail(const std::string& what) {
    if (error_.empty()) error_ = what;
  }

  // Call last: whether all members were known and right.
  Status Finish() {
    for (const auto& [key, value] : object_.items()) {
      if (!known_.contains(key)) Fail(fmt::format("unknown '{}'", key));
    }
    return error_.empty() ? OkStatus() : InvalidArgument("{}: {}", name_, error_);
  }

 private:
  const Json* Find(const char* key) {
    known_.insert(key);
    const auto found = object_.find(key);
    return found == object_.end() ? nullptr : &*found;
  }

  std::string TextOf(const Json& value, const char* key) {
    if (value.is_string()) return value.get<std::string>();
    Fail(fmt::format("'{}' is no text", key));
    return {};
  }

  const Json& object_;
  std::string name_;
  std::set<std::string> known_;
  std::string error_;
};

// "<file> <name>" each.
std::vector<TreeReference> References(ObjectReader* reader, const char* key) {
  std::vector<TreeReference> references;
  for (const Json& text : reader->Array(key)) {
    const std::string both = text.is_string() ? text.get<std::string>() : "";
    const std::size_t space = both.find(' ');
    if (space == std::string::npos) {
      reader->Fail(fmt::format("'{}' has '{}', expected a file, a space and a name", key, both));
      break;
    }
    references.push_back({both.substr(0, space), both.substr(space + 1)});
  }
  return references;
}

PaperStatus StatusOf(ObjectReader* reader) {
  const std::string text = reader->Text("status");
  for (const PaperStatus status : kStatuses) {
    if (text == ToString(status)) return status;
  }
  reader->Fail(fmt::format("status '{}', expected 'as printed', 'differs' or 'not done'", text));
  return PaperStatus::kNotDone;
}

StatusOr<PaperValue> ParseValue(const Json& json, const std::string& item) {
  ObjectReader reader(json, item);
  PaperValue value;
  value.what = reader.Text("what");
  value.column = reader.TextOr("column", "");
  value.printed = reader.TextOr("printed", "");
  value.run = reader.Text("run");
  value.rows = reader.TextOr("rows", value.rows);
  value.row = reader.Cells("row");
  value.value = reader.Text("value");
  value.error = reader.TextOr("error", "");
  value.unit = reader.TextOr("unit", "");
  if (!value.rows.starts_with('/') || value.rows.find('~') != std::string::npos) {
    reader.Fail(fmt::format("rows '{}', expected a JSON pointer", value.rows));
  }
  SHIFTMAP_RETURN_IF_ERROR(reader.Finish());
  return value;
}

StatusOr<PaperItem> ParseItem(const Json& json, const std::string& paper) {
  PaperItem item;
  const bool named = json.is_object() && json.contains("item") && json["item"].is_string();
  const std::string name =
      fmt::format("{} {}", paper, named ? json["item"].get<std::string>() : "?");
  ObjectReader reader(json, name);
  item.item = reader.Text("item");
  item.says = reader.Text("says");
  item.status = StatusOf(&reader);
  item.why = reader.TextOr("why", "");
  item.where = References(&reader, "where");
  item.tests = References(&reader, "tests");
  for (const Json& value : reader.Array("values")) {
    SHIFTMAP_ASSIGN_OR_RETURN(PaperValue parsed, ParseValue(value, name));
    item.values.push_back(std::move(parsed));
  }
  if (item.status != PaperStatus::kAsPrinted && item.why.empty()) reader.Fail("no 'why'");
  if (item.status != PaperStatus::kNotDone && item.where.empty()) reader.Fail("no 'where'");
  if (item.status != PaperStatus::kNotDone && item.tests.empty()) reader.Fail("no 'tests'");
  SHIFTMAP_RETURN_IF_ERROR(reader.Finish());
  return item;
}

StatusOr<PaperSection> ParseSection(const Json& json, const std::string& paper) {
  ObjectReader reader(json, paper + ": a section");
  PaperSection section;
  section.title = reader.Text("title");
  for (const Json& item : reader.Array("items")) {
    SHIFTMAP_ASSIGN_OR_RETURN(PaperItem parsed, ParseItem(item, paper));
    section.items.push_back(std::move(parsed));
  }
  SHIFTMAP_RETURN_IF_ERROR(reader.Finish());
  return section;
}

StatusOr<Paper> ParsePaper(const Json& json) {
  ObjectReader reader(json, "a paper");
  Paper paper;
  paper.name = reader.Text("name");
  paper.title = reader.Text("title");
  for (const Json& section : reader.Array("sections")) {
    SHIFTMAP_ASSIGN_OR_RETURN(PaperSection parsed, ParseSection(section, paper.name));
    paper.sections.push_back(std::move(parsed));
  }
  SHIFTMAP_RETURN_IF_ERROR(reader.Finish());
  return paper;
}

StatusOr<PaperRun> ParseRun(const Json& json) {
  ObjectReader reader(json, "a run");
  PaperRun run;
  run.name = reader.Text("name");
  run.command = reader.Text("command");
  run.options = reader.Cells("options");
  SHIFTMAP_RETURN_IF_ERROR(reader.Finish());
  return run;
}

StatusOr<PapersCatalogue> ParseDocument(const Json& json) {
  ObjectReader reader(json, "the document");
  PapersCatalogue catalogue;
  reader.Text("SPDX-License-Identifier");
  for (const Json& run : reader.Array("runs")) {
    SHIFTMAP_ASSIGN_OR_RETURN(PaperRun parsed, ParseRun(run));
    catalogue.runs.push_back(std::move(parsed));
  }
  for (const Json& paper : reader.Array("papers")) {
    SHIFTMAP_ASSIGN_OR_RETURN(Paper parsed, ParsePaper(paper));
    catalogue.papers.push_back(std::move(parsed));
  }
  SHIFTMAP_RETURN_IF_ERROR(reader.Finish());
  return catalogue;
}

// Calls `body(name, item)` for each item until one fails. Names are "T-IV (17)".
template <typename Body>
Status ForEachItem(const PapersCatalogue& catalogue, const Body& body) {
  for (const Paper& paper : catalogue.papers) {
    for (const PaperSection& section : paper.sections) {
      for (const PaperItem& item : section.items) {
        SHIFTMAP_RETURN_IF_ERROR(body(fmt::format("{} {}", paper.name, item.item), item));
      }
    }
  }
  return OkStatus();
}

Status CheckRunsAndNames(const PapersCatalogue& catalogue) {
  std::set<std::string> names;
  return ForEachItem(catalogue, [&](const std::string& name, const PaperItem& item) -> Status {
    if (!names.insert(name).second) return InvalidArgument("{}: is there twice", name);
    for (const PaperValue& value : item.values) {
      if (std::none_of(catalogue.runs.begin(), catalogue.runs.end(), [&](const PaperRun& run) {
            return run.name == value.run;
          })) {
        return InvalidArgument("{}: no run '{}'", name, value.run);
      }
    }
    return OkStatus();
  });
}

bool IsOfIdentifier(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_'; }

bool HasWord(std::string_view text, std::string_view word) {
  for (std::size_t at = text.find(word); at != std::string_view::npos;
       at = text.find(word, at + 1)) {
    const std::size_t end = at + word.size();
    const bool begins = at == 0 || !IsOfIdentifier(text[at - 1]);
    if (begins && (end == text.size() || !IsOfIdentifier(text[end]))) return true;
  }
  return false;
}

// Every part of `Class::Member` as a word.
bool HasSymbol(const std::string& text, std::string_view symbol) {
  while (true) {
    const std::size_t colons = symbol.find("::");
    if (!HasWord(text, symbol.substr(0, colons))) return false;
    if (colons == std::string_view::npos) return true;
    symbol.remove_prefix(colons + 2);
  }
}

bool HasTest(std::string text, const std::string& test) {
  text.erase(std::remove_if(
                 text.begin(), text.end(), [](unsigned char c) { return std::isspace(c) != 0; }),
             text.end());
  std::string arguments = "(" + test + ")";
  std::replace(arguments.begin(), arguments.end(), '.', ',');
  return std::ranges::any_of(std::array{"TEST", "TEST_F", "TEST_P"}, [&](const char* macro) {
    return text.find(macro + arguments) != std::string::npos;
  });
}

template <typename Has>
Status CheckReferences(const std::string& item,
                       const std::vector<TreeReference>& references,
                       const std::string& root,
                       std::string_view kind,
                       const Has& has) {
  for (const TreeReference& reference : references) {
    const StatusOr<std::string> text = ReadInputFile("file", root + "/" + reference.file);
    if (!text.ok()) return NotFound("{}: no file '{}'", item, reference.file);
    if (!has(*text, reference.name)) {
      return NotFound("{}: no {} '{}' in '{}'", item, kind, reference.name, reference.file);
    }
  }
  return OkStatus();
}

}  // namespace

std::string_view ToString(PaperStatus status) {
  switch (status) {
    case PaperStatus::kAsPrinted:
      return "as printed";
    case PaperStatus::kDiffers:
      return "differs";
    case PaperStatus::kNotDone:
      return "not done";
  }
  return "";
}

StatusOr<PapersCatalogue> ParsePapersCatalogue(const std::string& text) {
  const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (json.is_discarded()) return InvalidArgument("the document: is no JSON");
  SHIFTMAP_ASSIGN_OR_RETURN(PapersCatalogue catalogue, ParseDocument(json));
  SHIFTMAP_RETURN_IF_ERROR(CheckRunsAndNames(catalogue));
  return catalogue;
}

StatusOr<PapersCatalogue> ReadPapersCatalogue(const std::string& root) {
  const std::string path = fmt::format("{}/{}", root, kPapersCatalogueFile);
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, ReadInputFile("catalogue", path));
  StatusOr<PapersCatalogue> catalogue = ParsePapersCatalogue(text);
  if (!catalogue.ok()) {
    return InvalidArgument("catalogue '{}': {}", path, Message(catalogue.status()));
  }
  return catalogue;
}

Status CheckPapersCatalogue(const PapersCatalogue& catalogue, const std::string& root) {
  return ForEachItem(catalogue, [&](const std::string& name, const PaperItem& item) -> Status {
    SHIFTMAP_RETURN_IF_ERROR(CheckReferences(name, item.where, root, "symbol", HasSymbol));
    return CheckReferences(name, item.tests, root, "test", HasTest);
  });
}

}  // namespace shiftmap
