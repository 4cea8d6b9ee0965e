// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "proto/core/status.h"
#include "tools/experiment/papers_catalogue.h"
#include "tools/experiment/papers_results.h"

namespace shiftmap {

/// The page of both papers in Markdown: per section what each item says, where it is, which test
/// holds it and what came out beside what is printed. A value of a run that has no document is "not
/// run".
/// @param root  Of the source tree, as links from the page begin: "../..".
/// Errors: as FindPaperNumber(), with the item's name before it.
StatusOr<std::string> PapersPage(const PapersCatalogue& catalogue,
                                 const PaperDocuments& documents,
                                 const std::string& root);

/// The command line that makes the document of a run, in the folder `results`.
std::string PaperCommandLine(const PaperRun& run, const std::string& results);

}  // namespace shiftmap
