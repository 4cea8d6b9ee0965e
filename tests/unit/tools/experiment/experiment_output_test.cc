// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/experiment_output.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

ResultTable SmallTable() {
  ResultTable table({"name", "value"});
  table.AddRow({"x", 2.5});
  table.AddRow({"y", std::numeric_limits<double>::infinity()});
  return table;
}

TEST(ExperimentOutput, WritesTableFiguresAndDocument) {
  const testing::TempDir dir;
  const std::string folder = dir.File("new/folder");
  StatusOr<ExperimentOutput> created = ExperimentOutput::Create("trial", folder, /*dry_run=*/false);
  ASSERT_THAT(created, IsOk());
  ExperimentOutput& output = *created;
  EXPECT_THAT(output.WriteTable(SmallTable()), IsOk());
  EXPECT_THAT(output.WriteFigure("curve", Chart()), IsOk());
  const StatusOr<Json> document = output.WriteDocument({{"runs", 3}}, SmallTable());
  ASSERT_THAT(document, IsOk());
  EXPECT_EQ(output.files(),
            (std::vector<std::string>{
                folder + "/trial.csv", folder + "/trial-curve.svg", folder + "/trial.json"}));
  EXPECT_EQ(testing::ReadFile(folder + "/trial.csv"), "name,value\nx,2.5\ny,\n");
  const Json written = Json::parse(testing::ReadFile(folder + "/trial.json"));
  EXPECT_EQ(written["experiment"], "trial");
  EXPECT_EQ(written["options"]["runs"], 3);
  EXPECT_EQ(written["rows"][0]["value"], 2.5);
  EXPECT_TRUE(written["rows"][1]["value"].is_null());
  EXPECT_EQ((*document)["files"].size(), 3u);
}

TEST(ExperimentOutput, WritesNothingInADryRun) {
  const testing::TempDir dir;
  StatusOr<ExperimentOutput> created =
      ExperimentOutput::Create("trial", dir.File("folder"), /*dry_run=*/true);
  ASSERT_THAT(created, IsOk());
  ExperimentOutput& output = *created;
  EXPECT_THAT(output.WriteTable(SmallTable()), IsOk());
  EXPECT_THAT(output.WriteDocument(Json::object(), SmallTable()), IsOk());
  EXPECT_EQ(output.files().size(), 2u);
  EXPECT_FALSE(std::filesystem::exists(dir.File("folder")));
}

TEST(ExperimentOutput, AFolderThatCannotBeMadeIsNamedAtOnce) {
  const testing::TempDir dir;
  testing::WriteFile(dir.File("file"), "");
  EXPECT_THAT(ExperimentOutput::Create("trial", dir.File("file/folder"), /*dry_run=*/false),
              StatusIs(StatusCode::kInvalidArgument, "file/folder"));
}

}  // namespace
}  // namespace shiftmap
