// SPDX-License-Identifier: Apache-2.0
//
// A map store against a model of it, over random histories of everything that can happen to one.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/maintenance/compact.h"
#include "mapstore/maintenance/verify.h"
#include "mapstore/map_store.h"
#include "tests/property/store_model.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

constexpr int kHistories = 12;
constexpr int kSteps = 120;
constexpr double kTolerance = 1e-12;

class StoreHistory : public ::testing::TestWithParam<int> {
 protected:
  StoreHistory() { Reopen(); }

  int Below(int bound) { return std::uniform_int_distribution<int>(0, bound - 1)(random_); }
  bool Chance(double probability) { return std::bernoulli_distribution(probability)(random_); }

  Stamp RandomStamp() { return begin_ + std::chrono::seconds(Below(100'000)); }

  VersionNumber NumberOf(std::size_t version) {
    return VersionNumber(static_cast<VersionNumber::Value>(version) + 1);
  }

  void Reopen() {
    store_.reset();
    MapStore::OpenOptions options;
    options.access = MapStore::Access::kReadWriteCreate;
    // So few that checkpoints come and go all the time.
    options.checkpoint_rows = 4;
    options.clock = [this] { return clock_; };
    StatusOr<MapStore> store = MapStore::Open(path_, options);
    ASSERT_THAT(store, IsOk());
    store_.emplace(*std::move(store));
  }

  // The parent's map with other probabilities; some groups gain a mode, some lose one to a merge.
  MapContent Successor(const MapContent& parent) {
    MapContent content = parent;
    content.stamp = std::max(parent.stamp, RandomStamp());
    for (VehicleCalibration& vehicle : content.vehicles) {
      if (Chance(0.5)) vehicle = RandomVehicle(random_, vehicle.vehicle);
    }
    if (Chance(0.1) && !content.vehicles.empty()) content.vehicles.pop_back();
    for (LandmarkGroup& group : content.groups) {
      if (Chance(0.3)) {
        Mode mode = group.modes.back();
        mode.number = group.NextNumber();
        group.modes.push_back(mode);
      } else if (group.modes.size() > 1 && Chance(0.2)) {
        group.merged.push_back({group.modes.back().number, group.modes.front().number});
        std::sort(group.merged.begin(), group.merged.end(), [](const auto& a, const auto& b) {
          return a.number < b.number;
        });
        for (MergedMode& merged : group.merged) {
          if (merged.into == group.modes.back().number) merged.into = group.modes.front().number;
        }
        group.modes.pop_back();
      }
      group.chain = ModeChain::Uniform(static_cast<int>(group.modes.size()), 1e-5);
      group.probabilities = RandomDistribution(random_, group.chain.states());
    }
    std::vector<Eigen::Matrix2d> diagonal;
    for (const LandmarkGroup& group : content.groups) {
      for (const Mode& mode : group.modes) diagonal.push_back(mode.cov_p_map_landmark);
    }
    content.covariance = JointCovariance(std::move(diagonal), {});
    return content;
  }

  void Commit() {
    StoreModel::Version version;
    CommitOptions options;
    const bool child = model_.published() && Chance(0.85);
    if (child) {
      const std::size_t parent = *model_.published();
      version.parent = parent;
      options.parent = NumberOf(parent);
      version.content = Successor(model_.versions()[parent].content);
    } else {
      RandomMapOptions map;
      map.groups = 3;
      map.vehicles = Below(4);
      version.content = RandomContent(random_, map);
      version.content.stamp = RandomStamp();
    }
    version.reports_known = model_.reports().size();
    version.states = options.states_probabilities = Chance(0.4);
    if (child && version.states && Chance(0.5)) {
      // The statement's author read the ledger some reports ago.
      const auto missed = static_cast<std::size_t>(Below(3));
      version.reports_known =
          std::max(version.reports_known - std::min(missed, version.reports_known),
                   model_.versions()[*version.parent].reports_known);
      options.ledger_position =
          LedgerPosition(static_cast<LedgerPosition::Value>(version.reports_known));
    }
    if (Chance(0.3)) version.runs.push_back(RandomRun(RunHash(), version.content, version.states));
    // More runs than reports are about.
    if (Chance(0.5)) {
      version.runs.push_back(
          RandomRun(fmt::format("{:064x}", ++runs_), version.content, version.states));
    }
    options.publish = Chance(0.8);
    const StatusOr<CommitResult> result =
        store_->Commit("mine", version.content, {"test", "", 0, version.runs}, options);
    if (!version.states && version.parent && Maps(*version.parent, version.runs)) {
      EXPECT_THAT(result, StatusIs(StatusCode::kInvalidArgument, "is mapped already"));
      return;
    }
    const bool excluded =
        std::any_of(version.runs.begin(), version.runs.end(), [&](const RunRecord& run) {
          return model_.IsExcluded(run.identity(), run.vehicle, run.begin);
        });
    if (excluded) {
      EXPECT_THAT(result, StatusIs(StatusCode::kAborted, "since the build began"));
      return;
    }
    ASSERT_THAT(result, IsOk());
    hashes_.push_back(result->content_hash);
    const std::size_t index = model_.Commit(std::move(version));
    ASSERT_EQ(result->version, NumberOf(index));
    if (options.publish) model_.Publish(index);
  }

  RunRecord RandomRun(const std::string& hash, const MapContent& content, bool states) {
    RunRecord run{"run", hash, "truck", BeginOfLog(hash), begin_ + std::chrono::hours(72), {}, {}};
    Stamp begin = RandomStamp();
    for (int i = states ? 0 : Below(6); i > 0; --i) {
      begin += std::chrono::seconds(1 + Below(2000));
      const auto group = static_cast<std::size_t>(Below(static_cast<int>(content.groups.size())));
      run.evidence.push_back(RandomEvidence(
          random_, content.groups[group], begin, begin + std::chrono::seconds(Below(3000))));
    }
    return run;
  }

  // Whether a version, or an ancestor, has mapped one of the runs.
  bool Maps(std::size_t version, const std::vector<RunRecord>& runs) {
    for (std::optional<std::size_t> at = version; at; at = model_.versions()[*at].parent) {
      for (const RunRecord& known : model_.versions()[*at].runs) {
        for (const RunRecord& run : runs) {
          if (known.sha256 == run.sha256) return true;
        }
      }
    }
    return false;
  }

  std::string RunHash() { return std::string(64, static_cast<char>('a' + Below(6))); }

  // 'a...' and 'b...' are copies, of which one was cut off, and so on; others are of their own run.
  Stamp BeginOfLog(const std::string& hash) const {
    const char digit = hash.front();
    return begin_ + Duration(digit == '0' ? 3 + std::stoll(hash, nullptr, 16) : (digit - 'a') / 2);
  }

  void Return() {
    if (model_.versions().empty()) return;
    if (!model_.reports().empty() && Chance(0.1)) {
      const auto again = static_cast<std::size_t>(Below(static_cast<int>(model_.reports().size())));
      const StatusOr<ReturnResult> result = store_->Return(model_.reports()[again]);
      ASSERT_THAT(result, IsOk());
      EXPECT_TRUE(result->duplicate);
      return;
    }
    const int newest = static_cast<int>(model_.versions().size());
    const auto version = static_cast<std::size_t>(Chance(0.5) ? newest - 1 : Below(newest));
    const ShiftReport report = RandomReport(version);
    const StatusOr<ReturnResult> result = store_->Return(report);
    ASSERT_THAT(result, IsOk());
    EXPECT_FALSE(result->duplicate);
    model_.Return(report);
  }

  ShiftReport RandomReport(std::size_t version) {
    ShiftReport report;
    report.uuid = fmt::format("{:08x}-0000-4000-8000-{:012x}", Below(1 << 30), uuids_++);
    report.vehicle = Chance(0.8) ? "truck" : "loader";
    report.software = "test";
    report.area = "mine";
    report.version = NumberOf(version);
    report.content_hash = hashes_[version];
    if (Chance(0.4)) report.run_hash = RunHash();
    report.begin = report.run_hash.empty() ? begin_ : BeginOfLog(report.run_hash);
    report.end = begin_ + std::chrono::hours(72) + std::chrono::seconds(Below(3));
    Stamp begin = RandomStamp();
    for (int i = Below(6); i > 0; --i) {
      const std::vector<LandmarkGroup>& groups = model_.versions()[version].content.groups;
      begin += std::chrono::seconds(1 + Below(2000));
      report.evidence.push_back(
          RandomEvidence(random_,
                         groups[static_cast<std::size_t>(Below(static_cast<int>(groups.size())))],
                         begin,
                         begin + std::chrono::seconds(Below(3000))));
    }
    return report;
  }

  void Publish() {
    if (!model_.published()) return;
    const auto to = static_cast<std::size_t>(Below(static_cast<int>(model_.versions().size())));
    const Status status = store_->Publish("mine", NumberOf(to), NumberOf(*model_.published()));
    if (to == *model_.published()) {
      EXPECT_THAT(status, StatusIs(StatusCode::kAlreadyExists, ""));
    } else if (!model_.versions()[to].stored) {
      EXPECT_THAT(status, StatusIs(StatusCode::kFailedPrecondition, "compacted"));
    } else {
      ASSERT_THAT(status, IsOk());
      model_.Publish(to);
    }
  }

  void Rollback() {
    if (!model_.published()) return;
    const std::optional<std::size_t> parent = model_.versions()[*model_.published()].parent;
    const StatusOr<VersionNumber> result = store_->Rollback("mine");
    if (!parent) {
      EXPECT_THAT(result, StatusIs(StatusCode::kInvalidArgument, "no ancestor"));
    } else if (!model_.versions()[*parent].stored) {
      EXPECT_THAT(result, StatusIs(StatusCode::kFailedPrecondition, "compacted"));
    } else {
      ASSERT_THAT(result, IsOk());
      model_.Publish(*parent);
    }
  }

  void Compact() {
    RetentionPolicy policy;
    policy.keep_versions = 2 + Below(4);
    if (Chance(0.5)) policy.evidence_before = RandomStamp();
    ASSERT_THAT(CompactStore(path_, policy, false), IsOk());
    remembered_.clear();
    model_.Compact(static_cast<std::size_t>(policy.keep_versions));
  }

  void ExcludeOrInclude() {
    if (model_.versions().empty()) return;
    if (!model_.exclusions().empty() && Chance(0.5)) {
      const auto index =
          static_cast<std::size_t>(Below(static_cast<int>(model_.exclusions().size())));
      ASSERT_THAT(store_->IncludeAll("mine", {model_.exclusions()[index]}), IsOk());
      model_.Include(index);
      return;
    }
    Exclusion exclusion;
    exclusion.reason = "test";
    exclusion.held = Chance(0.3);
    if (Chance(0.3)) {
      exclusion.vehicle = Chance(0.5) ? "truck" : "loader";
      exclusion.since = begin_ + std::chrono::seconds(Chance(0.5) ? 0 : 1);
    } else if (Chance(0.5) && !model_.reports().empty()) {
      const auto index = static_cast<std::size_t>(Below(static_cast<int>(model_.reports().size())));
      const ShiftReport& report = model_.reports()[index];
      exclusion.run = report.run_hash.empty() ? report.uuid : report.run_hash;
    } else {
      exclusion.run = Chance(0.5) ? RunHash() : fmt::format("{:064x}", 1 + Below(runs_ + 1));
    }
    const Status status = store_->Exclude("mine", exclusion);
    if (status.code() == StatusCode::kAlreadyExists) return;
    ASSERT_THAT(status, IsOk());
    model_.Exclude(exclusion);
  }

  // What a reader is told now, to be asked for again at the end.
  void Remember() {
    if (!model_.published()) return;
    Remembered now{clock_, std::nullopt, std::nullopt, ""};
    const auto version = static_cast<std::size_t>(Below(static_cast<int>(hashes_.size())));
    if (Chance(0.5) && model_.versions()[version].stored) now.version = NumberOf(version);
    if (Chance(0.5)) now.at = RandomStamp();
    now.hash = ContentHash(store_->LoadAt("mine", now.version, now.at)->content());
    remembered_.push_back(now);
  }

  void AskWhatWasKnown() {
    for (const Remembered& then : remembered_) {
      const StatusOr<MapSnapshot> map =
          store_->LoadKnown("mine", then.known, then.version, then.at);
      ASSERT_THAT(map, IsOk());
      EXPECT_EQ(ContentHash(map->content()), then.hash);
    }
  }

  void Export() {
    if (!model_.published()) return;
    const std::string path = dir_.File("snapshot");
    ASSERT_THAT(store_->ExportSnapshot("mine", path), IsOk());
    StatusOr<MapStore> snapshot = MapStore::Open(path, MapStore::Access::kReadOnly);
    ASSERT_THAT(snapshot, IsOk());
    const Stamp later = begin_ + std::chrono::seconds(150'000);
    for (const std::optional<Stamp>& at : {std::optional<Stamp>(), std::optional<Stamp>(later)}) {
      EXPECT_EQ(ContentHash(snapshot->LoadAt("mine", std::nullopt, at)->content()),
                ContentHash(store_->LoadAt("mine", std::nullopt, at)->content()));
    }
  }

  void Compare() {
    if (Chance(0.3)) {
      const StatusOr<VerifyResult> verified = VerifyStore(path_);
      ASSERT_THAT(verified, IsOk());
      EXPECT_TRUE(verified->clean())
          << verified->defects[0].table << " " << verified->defects[0].row << " "
          << verified->defects[0].problem;
    }
    if (model_.published()) {
      EXPECT_EQ(*store_->PublishedVersion("mine"), NumberOf(*model_.published()));
    }
    for (std::size_t i = 0; i < model_.versions().size(); ++i) {
      if (!model_.versions()[i].stored || Chance(0.5)) continue;
      const Stamp at = begin_ + std::chrono::seconds(Below(120'000));
      const StatusOr<MapSnapshot> map = store_->LoadAt("mine", NumberOf(i), at);
      ASSERT_THAT(map, IsOk());
      EXPECT_EQ(map->content_hash(), hashes_[i]);
      const std::vector<Eigen::VectorXd> expected = model_.ProbabilitiesAt(i, at);
      for (std::size_t g = 0; g < expected.size(); ++g) {
        ASSERT_THAT(map->groups()[g].probabilities, IsNearMatrix(expected[g], kTolerance))
            << "version " << i + 1 << ", group " << g;
      }
    }
  }

  std::mt19937_64 random_{TestSeed(static_cast<std::uint64_t>(GetParam()))};
  const Stamp begin_ = StampFromNanoseconds(1'700'000'000'000'000'000);
  TempDir dir_;
  const std::string path_ = dir_.File("a.db");
  std::optional<MapStore> store_;
  StoreModel model_;
  std::vector<std::string> hashes_;  // Of the versions.

  struct Remembered {
    Stamp known;
    std::optional<VersionNumber> version;
    std::optional<Stamp> at;
    std::string hash;
  };
  std::vector<Remembered> remembered_;
  Stamp clock_ = begin_ + std::chrono::hours(100);
  int uuids_ = 0;
  int runs_ = 0;
};

TEST_P(StoreHistory, EqualsItsModel) {
  for (int step = 0; step < kSteps && !HasFatalFailure(); ++step) {
    SCOPED_TRACE(step);
    clock_ += std::chrono::seconds(1);
    const int choice = Below(100);
    if (choice < 20 || model_.versions().empty()) {
      Commit();
    } else if (choice < 70) {
      Return();
    } else if (choice < 76) {
      Publish();
    } else if (choice < 82) {
      Rollback();
    } else if (choice < 86) {
      Compact();
    } else if (choice < 89) {
      Reopen();
    } else if (choice < 91) {
      Export();
    } else if (choice < 95) {
      ExcludeOrInclude();
    } else {
      Compare();
    }
    if (Chance(0.3)) Remember();
  }
  Compare();
  AskWhatWasKnown();
}

INSTANTIATE_TEST_SUITE_P(Random, StoreHistory, ::testing::Range(0, kHistories));

}  // namespace
}  // namespace shiftmap::testing
