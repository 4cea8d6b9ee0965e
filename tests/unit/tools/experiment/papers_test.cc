// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "proto/core/check.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tools/experiment/experiments.h"
#include "tools/experiment/papers_catalogue.h"
#include "tools/experiment/papers_page.h"
#include "tools/experiment/papers_results.h"

namespace shiftmap {
namespace {

using ::testing::HasSubstr;
using testing::IsOk;
using ::testing::Not;
using testing::StatusIs;

const std::string kTree = SHIFTMAP_SOURCE_TREE;

PapersCatalogue Parsed(const Json& json) {
  StatusOr<PapersCatalogue> catalogue = ParsePapersCatalogue(json.dump());
  SHIFTMAP_CHECK(catalogue.ok(), "{}", Message(catalogue.status()));
  return *std::move(catalogue);
}

// One paper with one item, which has a number of one run.
Json SmallCatalogue() {
  return Json::parse(R"json({
    "SPDX-License-Identifier": "Apache-2.0",
    "runs": [{"name": "fast", "command": "trial --n 3", "options": {"n": 3}}],
    "papers": [{"name": "P", "title": "A paper", "sections": [{"title": "I First", "items": [{
      "item": "(1)", "says": "a | b", "status": "differs", "why": "no c",
      "where": ["code/sum.h Sum::Add"], "tests": ["tests/sum_test.cc Sum.Adds"],
      "values": [{"what": "x at 1", "printed": "2", "run": "fast", "row": {"at": 1, "of": "x"},
                  "value": "mean", "error": "se", "unit": "m"}]}]
}]
}]
})json");
}

Json& SmallItem(Json* catalogue) { return (*catalogue)["papers"][0]["sections"][0]["items"][0]; }

Json SmallDocument() {
  return Json::parse(R"json({
    "experiment": "trial", "version": "1.2", "options": {"n": 3, "cases": [1, 2]},
    "rows": [{"at": 1, "of": "x", "mean": 2.5, "se": 0.125, "other": 9},
             {"at": 1, "of": "y", "mean": 3.5, "se": null, "other": 9}]})json");
}

// A source tree that has what the small catalogue names.
class SmallTree {
 public:
  SmallTree() {
    Write("code/sum.h", "class Sum {\n  void Add(int addend);\n};\n");
    Write("tests/sum_test.cc", "TEST_F(Sum,\n       Adds) {}\n");
    Write(std::string(kPapersCatalogueFile), SmallCatalogue().dump());
    Write("results/fast/trial.json", SmallDocument().dump());
  }

  const std::string& root() const { return dir_.path(); }
  std::string File(const std::string& file) const { return dir_.File(file); }

  void Write(const std::string& file, const std::string& text) const {
    std::filesystem::create_directories(std::filesystem::path(File(file)).parent_path());
    testing::WriteFile(File(file), text);
  }

 private:
  testing::TempDir dir_;
};

int RunCommand(std::vector<std::string> arguments, std::string* out) {
  Application application("shiftmap-experiment", "Experiments");
  AddExperiments(&application);
  arguments.insert(arguments.begin(), "papers");
  std::ostringstream stream;
  const ExitCode code = application.Run(arguments, &stream, &stream);
  *out = stream.str();
  return static_cast<int>(code);
}

// A name that is not there any more is changed in the catalogue, and the page written again.
TEST(Papers, CatalogueNamesWhatIsThere) {
  const StatusOr<PapersCatalogue> catalogue = ReadPapersCatalogue(kTree);
  ASSERT_THAT(catalogue, IsOk());
  EXPECT_THAT(CheckPapersCatalogue(*catalogue, kTree), IsOk());
}

TEST(Papers, CatalogueHasEveryEquationAlgorithmFigureAndTable) {
  const StatusOr<PapersCatalogue> catalogue = ReadPapersCatalogue(kTree);
  ASSERT_THAT(catalogue, IsOk());
  ASSERT_EQ(catalogue->papers.size(), 2u);
  for (const Paper& paper : catalogue->papers) {
    std::string items;  // ", (1), fig. 2, ..."
    for (const PaperSection& section : paper.sections) {
      for (const PaperItem& item : section.items) items += ", " + item.item;
    }
    items += ",";
    for (int equation = 1; equation <= 31; ++equation) {
      EXPECT_THAT(items, HasSubstr(fmt::format(", ({}),", equation))) << paper.name;
    }
    const bool mine = paper.name == "T-IV";
    for (int figure = 1; figure <= (mine ? 9 : 11); ++figure) {
      const bool alone = items.find(fmt::format("fig. {}", figure)) != std::string::npos;
      const bool first = items.find(fmt::format("figs {}, ", figure)) != std::string::npos;
      const bool second =
          items.find(fmt::format("figs {}, {},", figure - 1, figure)) != std::string::npos;
      EXPECT_TRUE(alone || first || second) << paper.name << " figure " << figure;
    }
    EXPECT_THAT(items, HasSubstr(mine ? "Alg. 1" : "table 1"));
  }
}

// Who changes the catalogue writes the page again; it says how.
TEST(Papers, ThePageIsThatOfTheCatalogue) {
  const StatusOr<PapersCatalogue> catalogue = ReadPapersCatalogue(kTree);
  ASSERT_THAT(catalogue, IsOk());
  const std::string folder = kTree + "/tests/results";
  const StatusOr<PaperDocuments> documents = ReadPaperDocuments(*catalogue, {folder});
  ASSERT_THAT(documents, IsOk());
  const StatusOr<std::string> page = PapersPage(*catalogue, *documents, "../..");
  ASSERT_THAT(page, IsOk());
  EXPECT_TRUE(testing::ReadFile(folder + "/papers.md") == *page) << "papers.md is of another time";
  for (const auto& [run, document] : *documents) {
    EXPECT_EQ(CondensedDocument(document, run, *catalogue), document) << run;
  }
}

TEST(Papers, CellsAreShort) {
  const StatusOr<PapersCatalogue> catalogue = ReadPapersCatalogue(kTree);
  ASSERT_THAT(catalogue, IsOk());
  constexpr std::size_t kMostBytes = 120;
  for (const Paper& paper : catalogue->papers) {
    for (const PaperSection& section : paper.sections) {
      for (const PaperItem& item : section.items) {
        EXPECT_LE(item.says.size(), kMostBytes) << paper.name << item.item;
        EXPECT_LE(item.why.size(), kMostBytes) << paper.name << item.item;
      }
    }
  }
}

TEST(PapersCatalogueText, NamesTheItemAndWhatIsWrong) {
  const auto expect = [](const std::string& message, const auto& change) {
    Json json = SmallCatalogue();
    change(SmallItem(&json));
    EXPECT_THAT(ParsePapersCatalogue(json.dump()), StatusIs(StatusCode::kInvalidArgument, message));
  };
  expect("P (1): no 'says'", [](Json& item) { item.erase("says"); });
  expect("P (1): 'says' is no text", [](Json& item) { item["says"] = 3; });
  expect("P (1): unknown 'when'", [](Json& item) { item["when"] = ""; });
  expect("P (1): status 'done'", [](Json& item) { item["status"] = "done"; });
  expect("P (1): no 'why'", [](Json& item) { item.erase("why"); });
  expect("P (1): no 'where'", [](Json& item) { item.erase("where"); });
  expect("P (1): no 'tests'", [](Json& item) { item["tests"] = Json::array(); });
  expect("'where' has 'sum.h'", [](Json& item) { item["where"] = {"sum.h"}; });
  expect("P (1): 'tests' is no array", [](Json& item) { item["tests"] = "a b"; });
  expect("P (1): no run 'slow'", [](Json& item) { item["values"][0]["run"] = "slow"; });
  expect("P (1): rows 'rows'", [](Json& item) { item["values"][0]["rows"] = "rows"; });
  expect("P (1): 'row' has no number", [](Json& item) { item["values"][0]["row"]["at"] = true; });
  EXPECT_THAT(ParsePapersCatalogue("{"), StatusIs(StatusCode::kInvalidArgument, "no JSON"));
  EXPECT_THAT(ParsePapersCatalogue("[]"), StatusIs(StatusCode::kInvalidArgument, "no object"));
  Json twice = SmallCatalogue();
  Json& items = twice["papers"][0]["sections"][0]["items"];
  items.push_back(Json(items[0]));
  EXPECT_THAT(ParsePapersCatalogue(twice.dump()),
              StatusIs(StatusCode::kInvalidArgument, "P (1): is there twice"));
}

TEST(PapersCatalogueText, WhatIsNotDoneNeedsNoPlace) {
  Json json = SmallCatalogue();
  Json& item = SmallItem(&json);
  item["status"] = "not done";
  item.erase("where");
  item.erase("tests");
  EXPECT_THAT(ParsePapersCatalogue(json.dump()), IsOk());
}

TEST(PapersTree, NamesWhatIsMissing) {
  const SmallTree tree;
  const PapersCatalogue catalogue = Parsed(SmallCatalogue());
  EXPECT_THAT(CheckPapersCatalogue(catalogue, tree.root()), IsOk());
  tree.Write("tests/sum_test.cc", "TEST(Sum, AddsUp) {}\n// Sum.Adds\n");
  EXPECT_THAT(CheckPapersCatalogue(catalogue, tree.root()),
              StatusIs(StatusCode::kNotFound, "P (1): no test 'Sum.Adds' in 'tests/sum_test.cc'"));
  tree.Write("code/sum.h", "class Sum {\n  void AddAll();\n};\n");
  EXPECT_THAT(CheckPapersCatalogue(catalogue, tree.root()),
              StatusIs(StatusCode::kNotFound, "P (1): no symbol 'Sum::Add' in 'code/sum.h'"));
  std::filesystem::remove(tree.File("code/sum.h"));
  EXPECT_THAT(CheckPapersCatalogue(catalogue, tree.root()),
              StatusIs(StatusCode::kNotFound, "P (1): no file 'code/sum.h'"));
}

TEST(PapersResults, AreTakenFromTheOneRowThatFits) {
  const PapersCatalogue catalogue = Parsed(SmallCatalogue());
  PaperValue value = catalogue.papers[0].sections[0].items[0].values[0];
  const StatusOr<PaperNumber> number = FindPaperNumber(SmallDocument(), value);
  ASSERT_THAT(number, IsOk());
  EXPECT_EQ(number->value, 2.5);
  EXPECT_EQ(number->error, 0.125);
  value.row = {{"at", 1.0}, {"of", "y"}};
  const StatusOr<PaperNumber> other = FindPaperNumber(SmallDocument(), value);
  ASSERT_THAT(other, IsOk());
  EXPECT_TRUE(std::isnan(other->error));
  value.row = {{"at", 1.0}};
  EXPECT_THAT(FindPaperNumber(SmallDocument(), value),
              StatusIs(StatusCode::kNotFound, "run 'fast', '/rows' with at 1: 2 rows, expected 1"));
  value.row = {{"of", "x"}};
  value.value = "median";
  EXPECT_THAT(FindPaperNumber(SmallDocument(), value),
              StatusIs(StatusCode::kNotFound, "no 'median'"));
  value.rows = "/options/n";
  EXPECT_THAT(FindPaperNumber(SmallDocument(), value),
              StatusIs(StatusCode::kNotFound, "no array '/options/n'"));
}

TEST(PapersResults, AreThoseOfTheRunAskedForInTheFirstFolder) {
  const SmallTree tree;
  const PapersCatalogue catalogue = Parsed(SmallCatalogue());
  Json later = SmallDocument();
  later["version"] = "1.3";
  tree.Write("newer/fast/trial.json", later.dump());
  tree.Write("empty/README.md", "");
  const StatusOr<PaperDocuments> documents =
      ReadPaperDocuments(catalogue, {tree.File("empty"), tree.File("newer"), tree.File("results")});
  ASSERT_THAT(documents, IsOk());
  EXPECT_EQ(documents->at("fast")["version"], "1.3");
  later["options"]["n"] = 4;
  tree.Write("newer/fast/trial.json", later.dump());
  EXPECT_THAT(ReadPaperDocuments(catalogue, {tree.File("newer")}),
              StatusIs(StatusCode::kInvalidArgument, "expected the options n 3"));
  later["experiment"] = "error";
  tree.Write("newer/fast/trial.json", later.dump());
  EXPECT_THAT(ReadPaperDocuments(catalogue, {tree.File("newer")}),
              StatusIs(StatusCode::kInvalidArgument, "no document of 'trial'"));
  EXPECT_THAT(ReadPaperDocuments(catalogue, {tree.File("none")}),
              StatusIs(StatusCode::kNotFound, "none': no folder"));
}

TEST(PapersResults, CondensedSayTheSame) {
  const PapersCatalogue catalogue = Parsed(SmallCatalogue());
  const Json condensed = CondensedDocument(SmallDocument(), "fast", catalogue);
  EXPECT_EQ(condensed, Json::parse(R"json({
    "experiment": "trial", "version": "1.2", "options": {"n": 3},
    "rows": [{"at": 1, "of": "x", "mean": 2.5, "se": 0.125}]})json"));
  const StatusOr<std::string> page = PapersPage(catalogue, {{"fast", SmallDocument()}}, "..");
  ASSERT_THAT(page, IsOk());
  const StatusOr<std::string> same = PapersPage(catalogue, {{"fast", condensed}}, "..");
  ASSERT_THAT(same, IsOk());
  EXPECT_EQ(*same, *page);
}

TEST(PapersPage, HasItemsLinksAndNumbers) {
  const StatusOr<std::string> page =
      PapersPage(Parsed(SmallCatalogue()), {{"fast", SmallDocument()}}, "..");
  ASSERT_THAT(page, IsOk());
  EXPECT_THAT(*page,
              HasSubstr("| (1) | a \\| b | [Sum::Add](../code/sum.h) | "
                        "[Sum.Adds](../tests/sum_test.cc) | differs: no c |\n"));
  EXPECT_THAT(*page, HasSubstr("| (1) | x at 1 | 2 | 2.5 ± 0.1 m | fast |\n"));
  EXPECT_THAT(*page, HasSubstr("| P | 0 | 1 | 0 |\n"));
  EXPECT_THAT(*page,
              HasSubstr("| fast | 1.2 | `shiftmap-experiment trial --n 3 --output DIR/fast` |\n"));
}

TEST(PapersPage, NumbersHaveTheDigitsOfTheirError) {
  const PapersCatalogue catalogue = Parsed(SmallCatalogue());
  const auto expect = [&](double mean, const Json& error, const std::string& text) {
    Json document = SmallDocument();
    document["rows"][0]["mean"] = mean;
    document["rows"][0]["se"] = error;
    const StatusOr<std::string> page = PapersPage(catalogue, {{"fast", document}}, "..");
    ASSERT_THAT(page, IsOk());
    EXPECT_THAT(*page, HasSubstr("| " + text + " m | fast |"));
  };
  expect(0.06766, 0.00502, "0.068 ± 0.005");
  expect(0.18, 0.0068, "0.180 ± 0.007");
  expect(31.42, 2.4, "31 ± 2");
  expect(0.0461234, 1e-9, "0.0461 ± 0");
  expect(0.0461234, nullptr, "0.0461");
}

TEST(PapersPage, HasValuesWithColumnsSideBySide) {
  Json json = SmallCatalogue();
  Json& values = SmallItem(&json)["values"];
  values[0]["column"] = "x";
  values.push_back(Json(values[0]));
  values[1]["column"] = "y";
  values[1]["row"]["of"] = "y";
  values[1].erase("printed");
  const StatusOr<std::string> page = PapersPage(Parsed(json), {{"fast", SmallDocument()}}, "..");
  ASSERT_THAT(page, IsOk());
  EXPECT_THAT(*page,
              HasSubstr("\n\n| (1), in brackets: printed | x | y | run |\n"
                        "| --- | --- | --- | --- |\n"
                        "| x at 1 | 2.5 ± 0.1 m (2) | 3.5 m | fast |\n"));
}

TEST(PapersPage, SaysWhatWasNotRunAndWhatFailed) {
  const PapersCatalogue catalogue = Parsed(SmallCatalogue());
  const StatusOr<std::string> page = PapersPage(catalogue, {}, "..");
  ASSERT_THAT(page, IsOk());
  EXPECT_THAT(*page, HasSubstr("| (1) | x at 1 | 2 | not run | fast |\n"));
  EXPECT_THAT(*page, HasSubstr("| fast | not run |"));
  Json failed = SmallDocument();
  failed["rows"][0]["mean"] = nullptr;
  const StatusOr<std::string> other = PapersPage(catalogue, {{"fast", failed}}, "..");
  ASSERT_THAT(other, IsOk());
  EXPECT_THAT(*other, HasSubstr("| failed | fast |"));
  failed["rows"].clear();
  EXPECT_THAT(PapersPage(catalogue, {{"fast", failed}}, ".."),
              StatusIs(StatusCode::kNotFound, "P (1): run 'fast'"));
}

TEST(PapersCommand, WritesThePageAndTheResultsItNeeds) {
  const SmallTree tree;
  const std::string output = tree.File("docs/made/papers.md");
  std::string out;
  ASSERT_EQ(
      RunCommand({"--source", tree.root(), "--results", tree.File("results"), "--output", output},
                 &out),
      0)
      << out;
  EXPECT_EQ(out, "there    shiftmap-experiment trial --n 3 --output DIR/fast\n");
  const std::string page = testing::ReadFile(output);
  EXPECT_THAT(page, HasSubstr("(../../code/sum.h)"));
  EXPECT_THAT(testing::ReadFile(tree.File("docs/made/fast/trial.json")), Not(HasSubstr("other")));
  // From what is beside the page it comes out again.
  ASSERT_EQ(RunCommand({"--source",
                        tree.root(),
                        "--results",
                        tree.File("docs/made"),
                        "--output",
                        output,
                        "--quiet"},
                       &out),
            0)
      << out;
  EXPECT_EQ(testing::ReadFile(output), page);
}

TEST(PapersCommand, WithoutAnOutputChecksAndLists) {
  const SmallTree tree;
  std::string out;
  EXPECT_EQ(RunCommand({"--source", tree.root()}, &out), 0);
  EXPECT_EQ(out, "not run  shiftmap-experiment trial --n 3 --output DIR/fast\n");
  tree.Write("code/sum.h", "");
  EXPECT_EQ(RunCommand({"--source", tree.root()}, &out), static_cast<int>(ExitCode::kNotFound));
  EXPECT_THAT(out, HasSubstr("P (1): no symbol 'Sum::Add' in 'code/sum.h'"));
  EXPECT_EQ(std::count(out.begin(), out.end(), '\n'), 1) << out;
  EXPECT_EQ(RunCommand({"--source", tree.File("none")}, &out),
            static_cast<int>(ExitCode::kNotFound));
}

TEST(PapersCommand, WritesNothingInADryRun) {
  const SmallTree tree;
  std::string out;
  EXPECT_EQ(
      RunCommand({"--source", tree.root(), "--output", tree.File("page.md"), "--dry-run"}, &out), 0)
      << out;
  EXPECT_FALSE(std::filesystem::exists(tree.File("page.md")));
}

}  // namespace
}  // namespace shiftmap
