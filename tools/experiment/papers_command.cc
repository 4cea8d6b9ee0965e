// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/papers_command.h"

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "mapstore/core/atomic_file.h"
#include "mapstore/core/folder.h"
#include "tools/experiment/papers_catalogue.h"
#include "tools/experiment/papers_page.h"
#include "tools/experiment/papers_results.h"

namespace shiftmap {
namespace {

struct Arguments {
  std::string source = ".";
  std::vector<std::string> results;
  std::string output;
};

// Path, text.
using Files = std::vector<std::pair<std::string, std::string>>;

// The page, and beside it what of each document it needs.
StatusOr<Files> MakeFiles(const Arguments& arguments,
                          const PapersCatalogue& catalogue,
                          const PaperDocuments& documents) {
  const std::filesystem::path folder = std::filesystem::absolute(arguments.output).parent_path();
  const std::filesystem::path root = std::filesystem::relative(arguments.source, folder);
  Files files;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string page,
                            PapersPage(catalogue, documents, root.generic_string()));
  files.emplace_back(arguments.output, page);
  for (const PaperRun& run : catalogue.runs) {
    const auto document = documents.find(run.name);
    if (document == documents.end()) continue;
    files.emplace_back((folder / run.name / (run.Experiment() + ".json")).string(),
                       JsonText(CondensedDocument(document->second, run.name, catalogue)));
  }
  return files;
}

Status WriteFiles(const Files& files) {
  for (const auto& [path, text] : files) {
    SHIFTMAP_RETURN_IF_ERROR(MakeFolder(std::filesystem::absolute(path).parent_path().string()));
    SHIFTMAP_RETURN_IF_ERROR(WriteFileAtomically(path, text));
  }
  return OkStatus();
}

// Which runs there are, and the commands that make the others.
void Report(const PapersCatalogue& catalogue,
            const PaperDocuments& documents,
            const Files& files,
            Context& context) {
  Json runs = Json::array();
  std::string text;
  for (const PaperRun& run : catalogue.runs) {
    const bool there = documents.contains(run.name);
    const std::string command = PaperCommandLine(run, "DIR");
    runs.push_back({{"run", run.name}, {"there", there}, {"command", command}});
    text += fmt::format("{}  {}\n", there ? "there  " : "not run", command);
  }
  Json paths = Json::array();
  for (const auto& [path, content] : files) paths.push_back(path);
  context.Report({{"runs", runs}, {"files", paths}}, text);
}

Status MakePage(const Arguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const PapersCatalogue catalogue, ReadPapersCatalogue(arguments.source));
  SHIFTMAP_RETURN_IF_ERROR(CheckPapersCatalogue(catalogue, arguments.source));
  SHIFTMAP_ASSIGN_OR_RETURN(const PaperDocuments documents,
                            ReadPaperDocuments(catalogue, arguments.results));
  Files files;
  if (!arguments.output.empty()) {
    SHIFTMAP_ASSIGN_OR_RETURN(files, MakeFiles(arguments, catalogue, documents));
    if (!context.dry_run()) SHIFTMAP_RETURN_IF_ERROR(WriteFiles(files));
  }
  Report(catalogue, documents, files, context);
  return OkStatus();
}

}  // namespace

void AddPapersCommand(Application* application) {
  auto arguments = std::make_shared<Arguments>();
  application
      ->AddCommand("papers",
                   "Item by item of the two papers: where it is, its test, what came out. Lists "
                   "the commands that make the results",
                   [arguments](Context& context) { return MakePage(*arguments, context); })
      .Option("--source", &arguments->source, "Root of the source tree")
      .Option("--results",
              &arguments->results,
              "Folders of results, <folder>/<run>/<experiment>.json; of one run the first counts")
      .Option("--output", &arguments->output, "Page to write; none: only check and list")
      .Writes();
}

}  // namespace shiftmap
