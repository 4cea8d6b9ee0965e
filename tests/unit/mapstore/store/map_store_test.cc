// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map_store.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "tests/support/geometry_matchers.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::testing {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

class MapStoreTest : public ::testing::Test {
 protected:
  TempDir dir_;
  std::string path_ = dir_.File("a.db");
  MapStore store_ = OpenStore(path_);
  std::mt19937_64 random_{TestSeed(1)};

  CommitResult MustCommit(const MapContent& content, const CommitOptions& options = {}) {
    const StatusOr<CommitResult> result = store_.Commit("level 1", content, {}, options);
    EXPECT_THAT(result, IsOk());
    return *result;
  }
};

TEST_F(MapStoreTest, NewStoreIsEmpty) {
  EXPECT_THAT(*store_.Areas(), IsEmpty());
  EXPECT_EQ(*store_.PublishedVersion("level 1"), std::nullopt);
  EXPECT_THAT(store_.Versions("level 1"),
              StatusIs(StatusCode::kNotFound, "map store '" + path_ + "': no area 'level 1'"));
  EXPECT_THAT(store_.LoadAt("level 1"), StatusIs(StatusCode::kNotFound, "level 1"));
}

TEST_F(MapStoreTest, RandomContentComesBackBitByBit) {
  for (int round = 0; round < 10; ++round) {
    const MapContent content = RandomContent(random_, {.rhythms = 3});
    const CommitResult committed = MustCommit(content);
    EXPECT_EQ(committed.version, VersionNumber(round + 1));
    EXPECT_EQ(committed.content_hash, ContentHash(content));
    const StatusOr<MapSnapshot> loaded = store_.LoadVersion("level 1", committed.version);
    ASSERT_THAT(loaded, IsOk());
    EXPECT_EQ(ContentHash(loaded->content()), committed.content_hash);
    EXPECT_EQ(loaded->content_hash(), committed.content_hash);
    EXPECT_EQ(loaded->stamp(), content.stamp);
    ASSERT_EQ(loaded->groups().size(), content.groups.size());
    for (std::size_t i = 0; i < content.groups.size(); ++i) {
      EXPECT_EQ(loaded->groups()[i].signature, content.groups[i].signature);
      EXPECT_EQ(loaded->groups()[i].probabilities, content.groups[i].probabilities);
      EXPECT_EQ(loaded->groups()[i].chain.rate_matrix(), content.groups[i].chain.rate_matrix());
    }
    EXPECT_EQ(loaded->covariance().Dense(), content.covariance.Dense());
  }
}

TEST_F(MapStoreTest, EmptyMapAndOddSignaturesComeBack) {
  const CommitResult empty = MustCommit(MapContent{});
  EXPECT_THAT(store_.LoadVersion("level 1", empty.version)->groups(), IsEmpty());

  MapContent content = TwoStateContent(1e-5, 0.5, At(0.0));
  content.groups[0].signature = Signature(std::string("a\0b'\xff", 5));
  const CommitResult odd = MustCommit(content);
  EXPECT_EQ(store_.LoadVersion("level 1", odd.version)->groups()[0].signature,
            content.groups[0].signature);
}

TEST_F(MapStoreTest, SlightlyAsymmetricCovarianceIsStoredAsItsUpperHalf) {
  MapContent content = TwoStateContent(1e-5, 0.5, At(0.0));
  Eigen::Matrix2d covariance;
  covariance << 0.01, 1e-3, 1e-3 * (1.0 + 1e-12), 0.02;
  content.groups[0].modes[0].cov_p_map_landmark = covariance;
  content.covariance = JointCovariance({covariance}, {});
  const CommitResult committed = MustCommit(content);
  EXPECT_THAT(store_.LoadVersion("level 1", committed.version), IsOk());
}

TEST_F(MapStoreTest, InvalidContentIsRefused) {
  MapContent content = TwoStateContent(1e-5, 0.5, At(0.0));
  content.groups[0].probabilities = Eigen::Vector2d(0.5, 0.6);
  EXPECT_THAT(store_.Commit("level 1", content, {}, {}),
              StatusIs(StatusCode::kInvalidArgument, "group 'A'"));
  EXPECT_THAT(store_.Commit("", MapContent{}, {}, {}),
              StatusIs(StatusCode::kInvalidArgument, "area name"));
  EXPECT_THAT(*store_.Areas(), IsEmpty());
}

TEST_F(MapStoreTest, PublishedPointerMovesOnlyWhenAsked) {
  const MapContent content = TwoStateContent(1e-5, 0.5, At(0.0));
  const CommitResult first = MustCommit(content);
  const CommitResult draft = MustCommit(content, {first.version, false});
  EXPECT_EQ(*store_.PublishedVersion("level 1"), first.version);
  const CommitResult third = MustCommit(content, {first.version, true});
  EXPECT_EQ(*store_.PublishedVersion("level 1"), third.version);

  const StatusOr<std::vector<VersionSummary>> versions = store_.Versions("level 1");
  ASSERT_THAT(versions, IsOk());
  ASSERT_THAT(*versions, SizeIs(3));
  EXPECT_EQ((*versions)[0].parent, std::nullopt);
  EXPECT_EQ((*versions)[1].version, draft.version);
  EXPECT_EQ((*versions)[1].parent, first.version);
  EXPECT_FALSE((*versions)[1].published);
  EXPECT_TRUE((*versions)[2].published);
  EXPECT_GT((*versions)[2].created, At(0.0));
}

TEST_F(MapStoreTest, AreasAreListedByName) {
  ASSERT_THAT(store_.Commit("b", MapContent{}, {}, {}), IsOk());
  ASSERT_THAT(store_.Commit("a", MapContent{}, {}, {std::nullopt, false}), IsOk());
  const StatusOr<std::vector<AreaSummary>> areas = store_.Areas();
  ASSERT_THAT(areas, IsOk());
  ASSERT_THAT(*areas, SizeIs(2));
  EXPECT_EQ((*areas)[0].area, "a");
  EXPECT_EQ((*areas)[0].published, std::nullopt);
  EXPECT_EQ((*areas)[1].published, VersionNumber(1));
  EXPECT_EQ((*areas)[1].versions, 1);
}

TEST_F(MapStoreTest, CommitOnAMovedParentAbortsAndWritesNothing) {
  const MapContent content = TwoStateContent(1e-5, 0.5, At(0.0));
  const CommitResult first = MustCommit(content);
  const CommitResult second = MustCommit(content, {first.version, true});
  EXPECT_THAT(store_.Commit("level 1", content, {}, {first.version, true}),
              StatusIs(StatusCode::kAborted, "version 2 is published, expected version 1"));
  EXPECT_THAT(*store_.Versions("level 1"), SizeIs(2));
  EXPECT_EQ(*store_.PublishedVersion("level 1"), second.version);
  // Not published: no conflict. Without a parent: replaces whatever is published.
  MustCommit(content, {first.version, false});
  const CommitResult replacing = MustCommit(content);
  EXPECT_EQ(*store_.PublishedVersion("level 1"), replacing.version);
}

// Two first builds at the same time: neither knew of the other.
TEST_F(MapStoreTest, AFirstVersionMayBeToldNotToReplace) {
  const MapContent content = TwoStateContent(1e-5, 0.5, At(0.0));
  CommitOptions first;
  first.replace = false;
  const CommitResult published = MustCommit(content, first);
  EXPECT_THAT(store_.Commit("level 1", content, {}, first),
              StatusIs(StatusCode::kAborted, "version 1 is published, expected no version"));
  EXPECT_EQ(*store_.PublishedVersion("level 1"), published.version);
  EXPECT_THAT(*store_.Versions("level 1"), SizeIs(1));
  first.publish = false;
  MustCommit(content, first);
}

TEST_F(MapStoreTest, UnknownParentIsNotFound) {
  EXPECT_THAT(store_.Commit("level 1", MapContent{}, {}, {VersionNumber(4), true}),
              StatusIs(StatusCode::kNotFound, "no version 4"));
  EXPECT_THAT(*store_.Areas(), IsEmpty());
}

TEST_F(MapStoreTest, ProvenanceComesBack) {
  Provenance provenance;
  provenance.tool = "shiftmap-mapper 0.1.0";
  provenance.configuration = R"({"selector": "viterbi"})";
  provenance.seed = -7;
  RunRecord late{"late", "bb", "truck 2", At(50.0), At(60.0), {}};
  RunRecord early{"early", "aa", "truck 1", At(1.0), At(2.0), {}};
  early.trajectory = {{At(1.0), Se2(1.0, 2.0, 3.0)}, {At(2.0), Se2(-1e-300, 1e300, -3.14159)}};
  provenance.runs = {late, early, late};
  for (int version = 1; version <= 2; ++version) {
    ASSERT_THAT(store_.Commit("level 1", MapContent{}, provenance, {}), IsOk());
    const StatusOr<Provenance> loaded = store_.LoadProvenance("level 1", VersionNumber(version));
    ASSERT_THAT(loaded, IsOk());
    EXPECT_EQ(loaded->tool, provenance.tool);
    EXPECT_EQ(loaded->configuration, provenance.configuration);
    EXPECT_EQ(loaded->seed, -7);
    ASSERT_THAT(loaded->runs, SizeIs(2));
    EXPECT_EQ(loaded->runs[0].name, "early");
    EXPECT_EQ(loaded->runs[0].end, At(2.0));
    EXPECT_EQ(loaded->runs[1].vehicle, "truck 2");
    ASSERT_THAT(loaded->runs[0].trajectory, SizeIs(2));
    EXPECT_EQ(loaded->runs[0].trajectory[1].stamp, At(2.0));
    EXPECT_THAT(loaded->runs[0].trajectory[1].T_map_vehicle,
                IsNearPose(early.trajectory[1].T_map_vehicle, 0.0));
  }
}

TEST_F(MapStoreTest, RunsOfAVersionAreThoseOfItsAncestorsToo) {
  const auto commit = [&](const std::vector<std::string>& hashes, std::optional<int> parent) {
    Provenance provenance;
    for (const std::string& hash : hashes) {
      provenance.runs.push_back({hash, hash, "truck", At(0.0), At(1.0), {}});
    }
    CommitOptions options;
    if (parent) options.parent = VersionNumber(*parent);
    options.publish = false;
    ASSERT_THAT(store_.Commit("level 1", MapContent{}, provenance, options), IsOk());
  };
  commit({"a", "b"}, std::nullopt);
  commit({"c"}, 1);
  commit({"d"}, 1);
  commit({"b", "e"}, 3);
  commit({}, 2);
  const auto of = [&](int version) {
    return store_.RunIdentities("level 1", VersionNumber(version)).value();
  };
  EXPECT_THAT(of(1), ElementsAre("a", "b"));
  EXPECT_THAT(of(4), ElementsAre("a", "b", "d", "e"));
  EXPECT_THAT(of(5), ElementsAre("a", "b", "c"));
  std::vector<std::string> line;
  const StatusOr<std::vector<LineRun>> runs = store_.LineRuns("level 1", VersionNumber(4));
  ASSERT_THAT(runs, IsOk());
  for (const LineRun& run : *runs) {
    line.push_back(fmt::format("{} {}", run.run.sha256, run.version.value()));
  }
  EXPECT_THAT(line, ElementsAre("a 1", "b 1", "d 3", "e 4"));
  EXPECT_THAT(store_.RunIdentities("level 1", VersionNumber(6)),
              StatusIs(StatusCode::kNotFound, "no version 6"));
}

TEST_F(MapStoreTest, ExportedSnapshotGivesWhatTheStoreGives) {
  const MapContent content = RandomContent(random_);
  const CommitResult parent = MustCommit(content);
  MapContent newer = content;
  newer.stamp = content.stamp + std::chrono::hours(24);
  ShiftReport on_parent = EmptyReport(parent, "level 1", 1);
  for (const LandmarkGroup& group : content.groups) {
    const Stamp begin = newer.stamp + FromSeconds(100.0);
    on_parent.evidence.push_back(RandomEvidence(random_, group, begin, begin + FromSeconds(9.0)));
    const Stamp old = content.stamp + FromSeconds(100.0);
    on_parent.evidence.push_back(RandomEvidence(random_, group, old, old + FromSeconds(9.0)));
  }
  ASSERT_THAT(store_.Return(on_parent), IsOk());
  const CommitResult published = MustCommit(newer, {parent.version, true});
  ShiftReport on_published = EmptyReport(published, "level 1", 2);
  const Stamp begin = newer.stamp + FromSeconds(50.0);
  for (const LandmarkGroup& group : content.groups) {
    on_published.evidence.push_back(RandomEvidence(random_, group, begin, begin));
  }
  ASSERT_THAT(store_.Return(on_published), IsOk());
  ASSERT_THAT(store_.Commit("level 2", content, {}, {}), IsOk());

  const std::string snapshot_path = dir_.File("level 1?#%.snapshot");
  const StatusOr<std::string> sha256 = store_.ExportSnapshot("level 1", snapshot_path);
  ASSERT_THAT(sha256, IsOk());
  EXPECT_THAT(*sha256, SizeIs(64));
  StatusOr<MapStore> snapshot = MapStore::Open(snapshot_path, MapStore::Access::kReadOnly);
  ASSERT_THAT(snapshot, IsOk());
  EXPECT_THAT(*snapshot->Areas(), SizeIs(1));
  // The parent is there by its row, because a report refers to it.
  const std::vector<VersionSummary> versions = *snapshot->Versions("level 1");
  ASSERT_THAT(versions, SizeIs(2));
  EXPECT_FALSE(versions[0].content_stored);
  EXPECT_TRUE(versions[1].content_stored);
  EXPECT_EQ(snapshot->LoadVersion("level 1", published.version)->content_hash(),
            published.content_hash);
  EXPECT_THAT(snapshot->LoadVersion("level 1", parent.version),
              StatusIs(StatusCode::kNotFound, "only its row"));
  for (const std::optional<Stamp>& at : {std::optional<Stamp>(),
                                         std::optional<Stamp>(newer.stamp),
                                         std::optional<Stamp>(begin),
                                         std::optional<Stamp>(begin + std::chrono::hours(9))}) {
    EXPECT_EQ(ContentHash(snapshot->LoadAt("level 1", std::nullopt, at)->content()),
              ContentHash(store_.LoadAt("level 1", std::nullopt, at)->content()));
  }
  EXPECT_NE(ContentHash(store_.LoadAt("level 1")->content()), published.content_hash);
  EXPECT_THAT(snapshot->Return(on_published),
              StatusIs(StatusCode::kFailedPrecondition, "read-only"));
}

// The copy reads by a connection of its own, which a writer that waits for the first one keeps out.
class SnapshotBesideAWriterTest : public MapStoreTest,
                                  public ::testing::WithParamInterface<MapStore::Access> {};

INSTANTIATE_TEST_SUITE_P(Access,
                         SnapshotBesideAWriterTest,
                         ::testing::Values(MapStore::Access::kReadOnly,
                                           MapStore::Access::kReadWrite));

TEST_P(SnapshotBesideAWriterTest, SnapshotsAndReportsAtOneTimeDoNotBlockEachOther) {
  const CommitResult version = MustCommit(RandomContent(random_));
  std::atomic<bool> done{false};
  std::atomic<int> returned{0};
  std::jthread vehicles([&] {
    MapStore::OpenOptions options;
    options.access = MapStore::Access::kReadWrite;
    options.lock_timeout = std::chrono::seconds(2);
    MapStore store = *MapStore::Open(path_, options);
    for (int i = 0; i < 2000 && !done; ++i, ++returned) {
      EXPECT_THAT(store.Return(EmptyReport(version, "level 1", i)), IsOk());
    }
  });
  while (returned == 0) std::this_thread::yield();
  MapStore::OpenOptions options;
  options.access = GetParam();
  options.lock_timeout = std::chrono::seconds(60);
  MapStore reader = *MapStore::Open(path_, options);
  for (int i = 0; i < 15; ++i) {
    EXPECT_THAT(reader.ExportSnapshot("level 1", dir_.File("s.db")), IsOk());
  }
  done = true;
}

// A snapshot of a long ledger takes the newest checkpoint instead of the rows before it.
TEST_F(MapStoreTest, SnapshotOfALongLedgerIsShortAndGivesTheSame) {
  const MapContent content = RandomContent(random_);
  MapStore::OpenOptions options;
  options.access = MapStore::Access::kReadWriteCreate;
  options.checkpoint_rows = 10;
  MapStore store = *MapStore::Open(dir_.File("long.db"), options);
  const CommitResult version = *store.Commit("level 1", content, {}, {});
  Stamp newest;
  for (int i = 0; i < 30; ++i) {
    ShiftReport report = EmptyReport(version, "level 1", i);
    for (const LandmarkGroup& group : content.groups) {
      newest = content.stamp + std::chrono::hours(i);
      report.evidence.push_back(RandomEvidence(random_, group, newest, newest));
    }
    ASSERT_THAT(store.Return(report), IsOk());
  }
  ASSERT_THAT(store.ExportSnapshot("level 1", dir_.File("s.db")), IsOk());
  MapStore snapshot = *MapStore::Open(dir_.File("s.db"), MapStore::Access::kReadOnly);
  EXPECT_LT(snapshot.Reports("level 1")->size(), 10U);
  for (const std::optional<Stamp>& at : {std::optional<Stamp>(),
                                         std::optional<Stamp>(newest),
                                         std::optional<Stamp>(newest + std::chrono::hours(9))}) {
    EXPECT_EQ(ContentHash(snapshot.LoadAt("level 1", std::nullopt, at)->content()),
              ContentHash(store.LoadAt("level 1", std::nullopt, at)->content()));
  }
  EXPECT_THAT(snapshot.LoadAt("level 1", std::nullopt, content.stamp),
              StatusIs(StatusCode::kNotFound, "probabilities from"));
}

TEST_F(MapStoreTest, PublishAndRollbackMoveThePointerByCompareAndSwap) {
  const MapContent content = RandomContent(random_);
  const VersionNumber first = MustCommit(content).version;
  const VersionNumber second = MustCommit(content, {first, true}).version;
  const VersionNumber third = MustCommit(content, {second, false}).version;
  EXPECT_THAT(store_.Publish("level 1", third, first), StatusIs(StatusCode::kAborted, "version 2"));
  EXPECT_THAT(store_.Publish("level 1", second, first),
              StatusIs(StatusCode::kAlreadyExists, "published already"));
  EXPECT_THAT(store_.Publish("level 1", VersionNumber(9), second),
              StatusIs(StatusCode::kNotFound, "version 9"));
  ASSERT_THAT(store_.Publish("level 1", third, second), IsOk());
  EXPECT_EQ(*store_.PublishedVersion("level 1"), third);
  EXPECT_EQ(*store_.Rollback("level 1"), second);
  ASSERT_THAT(store_.Publish("level 1", third, second), IsOk());
  EXPECT_EQ(*store_.Rollback("level 1", first), first);
  EXPECT_THAT(store_.Rollback("level 1"),
              StatusIs(StatusCode::kInvalidArgument,
                       "no ancestor; shiftmap-inspect publish N --expected 1 takes another"));
  EXPECT_THAT(store_.Rollback("level 1", second),
              StatusIs(StatusCode::kInvalidArgument, "no ancestor"));
  EXPECT_THAT(store_.Rollback("level 1", VersionNumber(9)),
              StatusIs(StatusCode::kNotFound, "version 9"));
  std::vector<std::string> log;
  const std::vector<AuditEntry> entries = *store_.AuditLog("level 1");
  for (const AuditEntry& entry : entries) {
    log.push_back(entry.action + " " + entry.subject);
  }
  EXPECT_THAT(log,
              ElementsAre("commit 1",
                          "publish 1",
                          "commit 2",
                          "publish 2",
                          "commit 3",
                          "publish 3",
                          "rollback 2",
                          "publish 3",
                          "rollback 1"));
}

TEST_F(MapStoreTest, ExportNeedsAPublishedVersionAndAnotherFile) {
  MustCommit(MapContent{}, {std::nullopt, false});
  EXPECT_THAT(store_.ExportSnapshot("level 1", dir_.File("s.db")),
              StatusIs(StatusCode::kNotFound, "nothing is published"));
  MustCommit(MapContent{});
  EXPECT_THAT(store_.ExportSnapshot("level 1", path_),
              StatusIs(StatusCode::kInvalidArgument, "replace the store"));
  EXPECT_THAT(store_.ExportSnapshot("level 1", dir_.File("missing/s.db")),
              StatusIs(StatusCode::kNotFound, "folder"));
  EXPECT_THAT(store_.ExportSnapshot("level 1", dir_.File("s.db")), IsOk());
}

}  // namespace
}  // namespace shiftmap::testing
