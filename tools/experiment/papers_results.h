// SPDX-License-Identifier: Apache-2.0
//
// The numbers of the catalogue of the papers, out of documents that experiments wrote.
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "mapstore/cli/context.h"
#include "proto/core/status.h"
#include "tools/experiment/papers_catalogue.h"

namespace shiftmap {

/// Documents by the name of their run; a run that is not there was not run.
using PaperDocuments = std::map<std::string, Json>;

/// Reads `<folder>/<run>/<experiment>.json` of each run, from the first of the folders that has it.
/// Errors: kNotFound naming the folder that is not there; kInvalidArgument naming the file that is
/// no document of the run's experiment, or one of other options.
StatusOr<PaperDocuments> ReadPaperDocuments(const PapersCatalogue& catalogue,
                                            const std::vector<std::string>& folders);

/// A number of a document; not finite where the document has null.
struct PaperNumber {
  double value = 0.0;
  double error = 0.0;  ///< Standard error; not finite too where none is asked for.
};

/// Errors: kNotFound if the document has not exactly one such row, or not the members in it.
StatusOr<PaperNumber> FindPaperNumber(const Json& document, const PaperValue& value);

/// The document without the rows and members that the catalogue takes nothing of, and without
/// arrays beside them: a few kilobytes that say the same here. Precondition: FindPaperNumber() of
/// each of the run's values is OK.
Json CondensedDocument(const Json& document,
                       const std::string& run,
                       const PapersCatalogue& catalogue);

}  // namespace shiftmap
