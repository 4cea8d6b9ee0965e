// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/papers_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

namespace shiftmap {
namespace {

constexpr std::string_view kHead =
    "# The two papers, item by item\n"
    "\n"
    "What each paper prints, where it is in this tree, which test holds it, and what came out.\n"
    "Written from [the catalogue]({root}/{catalogue}) and from documents of experiments, whose\n"
    "numbers are taken and never typed, by\n"
    "\n"
    "    shiftmap-experiment papers --results DIR tests/results --output tests/results/papers.md\n"
    "\n"
    "with the [runs](#runs) in DIR; runs that are not there come from the folder of this page.\n"
    "The command fails where a file, symbol or test that the catalogue names is not there.\n";

// A cell must not end the cell or the row.
std::string Cell(const std::string& text) {
  std::string cell;
  for (const char c : text) {
    if (c == '|') cell += '\\';
    cell += c == '\n' ? ' ' : c;
  }
  return cell;
}

std::string Row(const std::vector<std::string>& cells) {
  std::string row = "|";
  for (const std::string& cell : cells) row += " " + cell + " |";
  return row + "\n";
}

std::string Head(const std::vector<std::string>& columns) {
  return "\n" + Row(columns) + Row(std::vector<std::string>(columns.size(), "---"));
}

std::string Links(const std::vector<TreeReference>& references, const std::string& root) {
  std::string links;
  for (const TreeReference& reference : references) {
    if (!links.empty()) links += ", ";
    links += fmt::format("[{}]({}/{})", reference.name, root, reference.file);
  }
  return links.empty() ? "–" : links;
}

std::string StatusCell(const PaperItem& item) {
  const std::string status(ToString(item.status));
  if (item.why.empty()) return status;
  const char* const sign = item.status == PaperStatus::kAsPrinted ? ";" : ":";
  return fmt::format("{}{} {}", status, sign, Cell(item.why));
}

// With a standard error, to the first digit of that; else to three digits.
std::string NumberText(const PaperNumber& number) {
  if (!std::isfinite(number.error)) return fmt::format("{:.3g}", number.value);
  if (number.error * 1e3 < std::abs(number.value)) return fmt::format("{:.3g} ± 0", number.value);
  const int digits = std::max(0, -static_cast<int>(std::floor(std::log10(number.error))));
  return fmt::format("{:.{}f} ± {:.{}f}", number.value, digits, number.error, digits);
}

std::string NumberCell(const PaperNumber& number, const std::string& unit) {
  if (!std::isfinite(number.value)) return "failed";
  return NumberText(number) + (unit.empty() ? "" : " " + unit);
}

StatusOr<std::string> CameOut(const PaperValue& value, const PaperDocuments& documents) {
  const auto document = documents.find(value.run);
  if (document == documents.end()) return std::string("not run");
  SHIFTMAP_ASSIGN_OR_RETURN(const PaperNumber number, FindPaperNumber(document->second, value));
  return NumberCell(number, value.unit);
}

std::string ItemTable(const PaperSection& section, const std::string& root) {
  std::string table = Head({"item", "what it says", "where", "test", "result"});
  for (const PaperItem& item : section.items) {
    table += Row({Cell(item.item),
                  Cell(item.says),
                  Links(item.where, root),
                  Links(item.tests, root),
                  StatusCell(item)});
  }
  return table;
}

std::string PrintedCell(const PaperValue& value) {
  return value.printed.empty() ? "–" : Cell(value.printed);
}

// A line per value that has no column; empty without such.
StatusOr<std::string> ValueLines(const PaperItem& item, const PaperDocuments& documents) {
  std::string lines;
  for (const PaperValue& value : item.values) {
    if (!value.column.empty()) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string came_out, CameOut(value, documents));
    lines += Row({Cell(item.item), Cell(value.what), PrintedCell(value), came_out, value.run});
  }
  return lines;
}

void AddOnce(const std::string& text, std::vector<std::string>* texts) {
  if (std::ranges::find(*texts, text) == texts->end()) texts->push_back(text);
}

// The values of an item that have columns: a line per `what`. What is printed is in brackets.
StatusOr<std::string> ColumnTable(const PaperItem& item, const PaperDocuments& documents) {
  std::vector<std::string> columns;
  std::vector<std::string> lines;
  std::map<std::pair<std::string, std::string>, std::string> cells;
  std::map<std::string, std::vector<std::string>> runs;
  for (const PaperValue& value : item.values) {
    if (value.column.empty()) continue;
    AddOnce(value.column, &columns);
    AddOnce(value.what, &lines);
    AddOnce(value.run, &runs[value.what]);
    SHIFTMAP_ASSIGN_OR_RETURN(std::string cell, CameOut(value, documents));
    if (!value.printed.empty()) cell += fmt::format(" ({})", Cell(value.printed));
    cells[{value.what, value.column}] = std::move(cell);
  }
  if (lines.empty()) return std::string();
  std::vector<std::string> head = {Cell(item.item) + ", in brackets: printed"};
  for (const std::string& column : columns) head.push_back(Cell(column));
  head.emplace_back("run");
  std::string table = Head(head);
  for (const std::string& line : lines) {
    std::vector<std::string> row = {Cell(line)};
    for (const std::string& column : columns) row.push_back(cells[{line, column}]);
    row.push_back(fmt::format("{}", fmt::join(runs[line], ", ")));
    table += Row(row);
  }
  return table;
}

// The tables of what came out; empty if the section has no values.
StatusOr<std::string> ValueTables(const Paper& paper,
                                  const PaperSection& section,
                                  const PaperDocuments& documents) {
  std::string lines;
  std::string tables;
  for (const PaperItem& item : section.items) {
    const StatusOr<std::string> of_item = ValueLines(item, documents);
    const StatusOr<std::string> table = ColumnTable(item, documents);
    for (const auto* part : {&of_item, &table}) {
      if (part->ok()) continue;
      return NotFound("{} {}: {}", paper.name, item.item, Message(part->status()));
    }
    lines += *of_item;
    tables += *table;
  }
  if (!lines.empty()) lines = Head({"item", "value", "printed", "came out", "run"}) + lines;
  return lines + tables;
}

StatusOr<std::string> PaperPart(const Paper& paper,
                                const PaperDocuments& documents,
                                const std::string& root) {
  std::string part = fmt::format("\n## {}\n\n{}\n", paper.name, paper.title);
  for (const PaperSection& section : paper.sections) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string values, ValueTables(paper, section, documents));
    part += fmt::format("\n### {}\n", section.title) + ItemTable(section, root) + values;
  }
  return part;
}

std::string CountTable(const PapersCatalogue& catalogue) {
  constexpr std::array kColumns = {
      PaperStatus::kAsPrinted, PaperStatus::kDiffers, PaperStatus::kNotDone};
  std::string table = Head({"items", "as printed", "differs", "not done"});
  for (const Paper& paper : catalogue.papers) {
    std::map<PaperStatus, int> counts;
    for (const PaperSection& section : paper.sections) {
      for (const PaperItem& item : section.items) ++counts[item.status];
    }
    std::vector<std::string> cells = {paper.name};
    for (const PaperStatus status : kColumns) cells.push_back(std::to_string(counts[status]));
    table += Row(cells);
  }
  return table;
}

std::string RunTable(const PapersCatalogue& catalogue, const PaperDocuments& documents) {
  std::string table = "\n## Runs\n" + Head({"run", "of version", "command"});
  for (const PaperRun& run : catalogue.runs) {
    const auto document = documents.find(run.name);
    const std::string version = document == documents.end()
                                    ? "not run"
                                    : document->second.value("version", std::string("?"));
    table += Row({run.name, version, fmt::format("`{}`", PaperCommandLine(run, "DIR"))});
  }
  return table;
}

}  // namespace

StatusOr<std::string> PapersPage(const PapersCatalogue& catalogue,
                                 const PaperDocuments& documents,
                                 const std::string& root) {
  std::string page = fmt::format(fmt::runtime(kHead),
                                 fmt::arg("root", root),
                                 fmt::arg("catalogue", kPapersCatalogueFile)) +
                     CountTable(catalogue);
  for (const Paper& paper : catalogue.papers) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string part, PaperPart(paper, documents, root));
    page += part;
  }
  return page + RunTable(catalogue, documents);
}

std::string PaperCommandLine(const PaperRun& run, const std::string& results) {
  return fmt::format("shiftmap-experiment {} --output {}/{}", run.command, results, run.name);
}

}  // namespace shiftmap
