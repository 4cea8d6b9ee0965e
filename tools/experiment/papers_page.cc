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
    "What each paper prints, where it is in this tree, which test holds it, and what came out. "
    "The\n"
    "command `shiftmap-experiment papers` writes this page from [its "
    "catalogue]({root}/{catalogue})\n"
    "and from documents of experiments, whose numbers are taken and never typed; it fails where a\n"
    "file, symbol or test that is named here is not there. *Differs* and *not done* have their\n"
    "reason beside them.\n";

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

std::string NumberCell(const PaperNumber& number, const std::string& unit) {
  if (!std::isfinite(number.value)) return "failed";
  std::string text = fmt::format("{:.3g}", number.value);
  if (std::isfinite(number.error)) text += fmt::format(" ± {:.1g}", number.error);
  return unit.empty() ? text : text + " " + unit;
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

// Empty if the section has no values.
StatusOr<std::string> ValueTable(const Paper& paper,
                                 const PaperSection& section,
                                 const PaperDocuments& documents) {
  std::string rows;
  for (const PaperItem& item : section.items) {
    for (const PaperValue& value : item.values) {
      const StatusOr<std::string> came_out = CameOut(value, documents);
      if (!came_out.ok()) {
        return NotFound("{} {}: {}", paper.name, item.item, Message(came_out.status()));
      }
      rows += Row({Cell(item.item), Cell(value.what), Cell(value.printed), *came_out, value.run});
    }
  }
  if (rows.empty()) return rows;
  return Head({"item", "value", "printed", "came out", "run"}) + rows;
}

StatusOr<std::string> PaperPart(const Paper& paper,
                                const PaperDocuments& documents,
                                const std::string& root) {
  std::string part = fmt::format("\n## {}\n\n{}\n", paper.name, paper.title);
  for (const PaperSection& section : paper.sections) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string values, ValueTable(paper, section, documents));
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
