// SPDX-License-Identifier: Apache-2.0
#include "mapstore/maintenance/compact.h"

#include <gtest/gtest.h>

#include <chrono>
#include <random>
#include <string>
#include <vector>

#include "mapstore/map_store.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::testing {
namespace {

using ::testing::SizeIs;

// Ten nightly versions, a day apart, and a report against each from the day after it.
class CompactTest : public ::testing::Test {
 protected:
  CompactTest() {
    std::mt19937_64 random(TestSeed(21));
    MapStore store = OpenStore(path_);
    MapContent content = RandomContent(random);
    content.stamp = At(0.0);
    std::optional<VersionNumber> parent;
    for (int i = 0; i < kNights; ++i) {
      content.stamp += std::chrono::hours(24);
      CommitOptions options;
      options.parent = parent;
      const CommitResult version = *store.Commit("mine", content, {}, options);
      parent = version.version;
      ShiftReport report = EmptyReport(version, "mine", i);
      const Stamp begin = content.stamp + std::chrono::hours(6);
      report.evidence = {RandomEvidence(random, content.groups[0], begin, begin)};
      report.decisions = {{content.groups[0].signature, ModeNumber(1), begin, 20.0}};
      report.end = begin;
      EXPECT_THAT(store.Return(report), IsOk());
    }
  }

  static constexpr int kNights = 10;
  TempDir dir_;
  const std::string path_ = dir_.File("a.db");
};

TEST_F(CompactTest, KeepsTheNewestVersionsTheRestStaysExplained) {
  RetentionPolicy policy;
  policy.keep_versions = 3;
  const std::string before = ContentHash(OpenStore(path_).LoadAt("mine")->content());
  EXPECT_EQ(CompactStore(path_, policy, true)->versions, 7);
  EXPECT_THAT(OpenStore(path_).LoadAt("mine", VersionNumber(1)), IsOk());
  const StatusOr<CompactResult> result = CompactStore(path_, policy, false);
  ASSERT_THAT(result, IsOk());
  EXPECT_EQ(result->versions, 7);
  EXPECT_EQ(result->evidence_rows, 0);
  EXPECT_LT(result->bytes_after, result->bytes_before);
  MapStore store = OpenStore(path_);
  const std::vector<VersionSummary> versions = *store.Versions("mine");
  ASSERT_THAT(versions, SizeIs(kNights));
  EXPECT_FALSE(versions[6].content_stored);
  EXPECT_TRUE(versions[7].content_stored);
  EXPECT_THAT(versions[0].content_hash, SizeIs(64));
  EXPECT_EQ(ContentHash(store.LoadAt("mine")->content()), before);
  EXPECT_THAT(store.LoadAt("mine", VersionNumber(1)),
              StatusIs(StatusCode::kNotFound, "only its row"));
  EXPECT_THAT(store.Rollback("mine", VersionNumber(2)),
              StatusIs(StatusCode::kFailedPrecondition, "compacted away"));
  EXPECT_THAT(store.Rollback("mine", VersionNumber(8)), IsOk());
}

TEST_F(CompactTest, EvidenceThatCountsForAKeptVersionStays) {
  RetentionPolicy policy;
  policy.keep_versions = 2;
  policy.evidence_before = At(1e9);
  const std::string before = ContentHash(OpenStore(path_).LoadAt("mine")->content());
  const std::string before_9 =
      ContentHash(OpenStore(path_).LoadAt("mine", VersionNumber(9))->content());
  const StatusOr<CompactResult> result = CompactStore(path_, policy, false);
  ASSERT_THAT(result, IsOk());
  EXPECT_EQ(result->evidence_rows, kNights - 2);
  EXPECT_EQ(result->decisions, kNights);
  MapStore store = OpenStore(path_);
  EXPECT_EQ(ContentHash(store.LoadAt("mine")->content()), before);
  EXPECT_EQ(ContentHash(store.LoadAt("mine", VersionNumber(9))->content()), before_9);
  // Reports stay by UUID: one that comes again changes nothing.
  EXPECT_THAT(*store.Reports("mine"), SizeIs(kNights));
  const VersionSummary first = (*store.Versions("mine"))[0];
  EXPECT_TRUE(store.Return(EmptyReport({first.version, first.content_hash}, "mine", 0))->duplicate);
}

TEST_F(CompactTest, MustKeepAVersion) {
  RetentionPolicy policy;
  policy.keep_versions = 0;
  EXPECT_THAT(CompactStore(path_, policy, false),
              StatusIs(StatusCode::kInvalidArgument, "at least 1"));
}

}  // namespace
}  // namespace shiftmap::testing
