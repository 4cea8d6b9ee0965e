// SPDX-License-Identifier: Apache-2.0
//
// The ledger's rows as chains are learned from them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "mapstore/map_store.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::testing {
namespace {

using ::testing::ElementsAre;

class EvidenceRowsTest : public ::testing::Test {
 protected:
  CommitResult Commit(std::optional<VersionNumber> parent, double stamp, const Provenance& from) {
    CommitOptions options;
    options.parent = parent;
    options.publish = false;
    const auto version = store_.Commit("a", TwoStateContent(1e-3, 0.7, At(stamp)), from, options);
    EXPECT_THAT(version, IsOk());
    return *version;
  }

  // A report with one visit, which begins `number` seconds after the origin.
  void Return(const CommitResult& version, int number, const std::string& run_hash = "") {
    ShiftReport report = EmptyReport(version, "a", number);
    report.run_hash = run_hash;
    report.evidence = {TwoStateEvidence(At(number), At(number + 0.5), -1.0, -0.25 * number)};
    EXPECT_THAT(store_.Return(report), IsOk());
  }

  // Begins of the visits. [s]
  std::vector<double> Begins(const CommitResult& version,
                             const std::set<std::string>& without_runs = {}) {
    const auto rows = store_.Evidence("a", version.version, without_runs);
    EXPECT_THAT(rows, IsOk());
    std::vector<double> begins;
    for (const EvidenceRow& row : *rows) begins.push_back(ToSeconds(row.evidence.begin - At(0.0)));
    return begins;
  }

  TempDir dir_;
  MapStore store_ = OpenStore(dir_.File("a.db"));
};

TEST_F(EvidenceRowsTest, AreThoseOfTheLineInTheOrderOfTime) {
  const CommitResult first = Commit(std::nullopt, 0.0, {});
  Return(first, 30);  // Known when its children are made.
  const CommitResult second = Commit(first.version, 100.0, {});
  const CommitResult other = Commit(first.version, 100.0, {});
  Return(first, 20);
  Return(second, 10);
  Return(other, 15);
  EXPECT_THAT(Begins(second), ElementsAre(10.0, 20.0, 30.0));
  EXPECT_THAT(Begins(other), ElementsAre(15.0, 20.0, 30.0));
  EXPECT_THAT(Begins(first), ElementsAre(10.0, 15.0, 20.0, 30.0));
}

TEST_F(EvidenceRowsTest, CarryWhatWasReported) {
  const CommitResult version = Commit(std::nullopt, 0.0, {});
  Return(version, 4);
  const auto rows = store_.Evidence("a", version.version);
  ASSERT_THAT(rows, IsOk());
  ASSERT_EQ(rows->size(), 1u);
  const EvidenceRow& row = rows->front();
  EXPECT_EQ(row.source, EmptyReport(version, "a", 4).uuid);
  EXPECT_EQ(row.evidence.signature, Signature("A"));
  EXPECT_EQ(row.evidence.end, At(4.5));
  EXPECT_EQ(row.evidence.observations, 1);
  ASSERT_EQ(row.evidence.modes.size(), 2u);
  EXPECT_EQ(row.evidence.modes[1].mode, ModeNumber(1));
  EXPECT_EQ(row.evidence.modes[1].log_likelihood, -1.0);
}

// One report per log, whether a map was built from it or not, and none of the logs left out.
TEST_F(EvidenceRowsTest, CountEachLogOnce) {
  const std::string built(64, 'a');
  const std::string driven(64, 'b');
  const CommitResult first = Commit(std::nullopt, 0.0, {});
  Return(first, 10, built);
  Return(first, 20, driven);
  Provenance from;
  from.runs = {{"run", built, "truck 1", At(5.0), At(50.0), {}}};
  const CommitResult second = Commit(first.version, 100.0, from);
  Return(second, 21, driven);
  EXPECT_THAT(Begins(second), ElementsAre(10.0, 20.0));
  EXPECT_THAT(Begins(second, {driven}), ElementsAre(10.0));
  EXPECT_THAT(Begins(second, {built, driven}), ElementsAre());
}

// A mapped run has rows of its own; the report about it counts where it is not mapped.
TEST_F(EvidenceRowsTest, OfAMappedRunAreThoseOfTheVersionThatMappedIt) {
  const std::string mapped(64, 'a');
  const CommitResult first = Commit(std::nullopt, 0.0, {});
  Return(first, 10, mapped);
  RunRecord run{"run", mapped, "truck 1", At(5.0), At(50.0), {}};
  run.evidence = {TwoStateEvidence(At(11.0), At(12.0), 0.0, 1.0)};
  CommitOptions options;
  options.parent = first.version;
  options.publish = false;
  options.states_probabilities = false;
  const CommitResult second =
      *store_.Commit("a", TwoStateContent(1e-3, 0.7, At(100.0)), {"test", "", 0, {run}}, options);
  EXPECT_THAT(Begins(second), ElementsAre(11.0));
  EXPECT_THAT(Begins(second, {mapped}), ElementsAre());
  EXPECT_THAT(Begins(first), ElementsAre(10.0));
}

TEST_F(EvidenceRowsTest, OfAVersionThatIsNotThereAreAnError) {
  Commit(std::nullopt, 0.0, {});
  EXPECT_THAT(store_.Evidence("a", VersionNumber(2)), StatusIs(StatusCode::kNotFound, "version 2"));
}

}  // namespace
}  // namespace shiftmap::testing
