// SPDX-License-Identifier: Apache-2.0
//
// What of the two papers is where in the source tree: the catalogue tools/experiment/papers.json.
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "proto/core/status.h"
#include "tools/experiment/result_table.h"

namespace shiftmap {

/// The catalogue's place in the source tree.
inline constexpr std::string_view kPapersCatalogueFile = "tools/experiment/papers.json";

/// A name in a file of the source tree.
struct TreeReference {
  std::string file;  ///< Relative to the tree's root.
  std::string name;  ///< A symbol, `Class::Member` too, or a test, `Suite.Name`.
};

/// An experiment whose document has numbers of the papers' figures and tables.
struct PaperRun {
  std::string name;     ///< Also of the folder that its files are in.
  std::string command;  ///< Of shiftmap-experiment, without --output; begins with its name.

  /// What the document has to have under "options", so that no other run is taken for this one.
  std::vector<std::pair<std::string, ResultTable::Cell>> options;

  /// The command's name: the stem of the document's file.
  std::string Experiment() const { return command.substr(0, command.find(' ')); }
};

/// A number of a document, beside what is printed.
struct PaperValue {
  std::string what;
  std::string column;          ///< Values of one `what` side by side have columns; else empty.
  std::string printed;         ///< As text; empty for a figure that has no number there.
  std::string run;             ///< Name of a PaperRun.
  std::string rows = "/rows";  ///< JSON pointer to an array of objects.
  std::vector<std::pair<std::string, ResultTable::Cell>> row;  ///< Members of the object to take.
  std::string value;                                           ///< Its member with the number.
  std::string error;  ///< Its member with the standard error; may be empty.
  std::string unit;   ///< May be empty.
};

enum class PaperStatus { kAsPrinted, kDiffers, kNotDone };

/// "as printed", "differs", "not done".
std::string_view ToString(PaperStatus status);

/// An equation, algorithm, figure, table or rule of a paper.
struct PaperItem {
  std::string item;  ///< "(17)", "fig. 6", "VI-B".
  std::string says;
  PaperStatus status = PaperStatus::kNotDone;
  std::string why;                   ///< Empty only where it is as printed.
  std::vector<TreeReference> where;  ///< Empty only where it is not done; so are `tests`.
  std::vector<TreeReference> tests;
  std::vector<PaperValue> values;
};

struct PaperSection {
  std::string title;
  std::vector<PaperItem> items;
};

struct Paper {
  std::string name;  ///< As headers cite it.
  std::string title;
  std::vector<PaperSection> sections;
};

struct PapersCatalogue {
  std::vector<PaperRun> runs;
  std::vector<Paper> papers;
};

/// Reads the JSON of a catalogue. Errors: kInvalidArgument naming the item and what is missing,
/// unknown, of a wrong type, or against what the members above say.
StatusOr<PapersCatalogue> ParsePapersCatalogue(const std::string& text);

/// Reads the catalogue of a source tree. Errors: as ParsePapersCatalogue(); kNotFound.
StatusOr<PapersCatalogue> ReadPapersCatalogue(const std::string& root);

/// Checks that the tree has every file, symbol and test that the catalogue names. Errors: kNotFound
/// naming the item and the first one that is missing.
Status CheckPapersCatalogue(const PapersCatalogue& catalogue, const std::string& root);

}  // namespace shiftmap
