// SPDX-License-Identifier: Apache-2.0
//
// The power goes at any moment of a store's life, and takes any part of what was not synced: the
// store comes back in the state before or after the call that was under way, and with all that was
// acknowledged.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "proto/core/check.h"
#include "tests/fault/fault_plan.h"
#include "tests/fault/power_loss_disk.h"
#include "tests/fault/store_steps.h"
#include "tests/support/random_map.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

// Far above the requests of any check.
constexpr int kEndless = 1'000'000;

// A life of a store as the disk saw it.
struct RecordedLife {
  std::vector<DiskChange> changes;
  std::vector<std::size_t> acknowledged;  // Per step: the number of changes when it returned OK.
  std::vector<std::string> states;        // Before the first step and after each.
  std::vector<std::string> names;         // Of the steps.
};

RecordedLife Record() {
  const TempDir dir;
  const StoreFiles files(dir.path());
  DiskRecorder recorder(dir.path());
  const ObservedFiles observed(recorder);
  RecordedLife life;
  life.states.push_back(StateOf(files));
  for (const StoreStep& step : StoreLife()) {
    const Status status = step.run(files);
    SHIFTMAP_CHECK(status.ok(), "{}: {}", step.name, Message(status));
    life.acknowledged.push_back(recorder.changes().size());
    const std::size_t before = recorder.changes().size();
    life.states.push_back(StateOf(files));
    SHIFTMAP_CHECK(recorder.changes().size() == before, "reading changes files");
    life.names.push_back(step.name);
  }
  life.changes = recorder.changes();
  return life;
}

const RecordedLife& Life() {
  static const RecordedLife life = Record();
  return life;
}

// Cuts the power after `changes` changes. Returns what is wrong then, or nothing.
std::string CheckImage(const PowerLossDisk& disk,
                       std::size_t changes,
                       Leftover leftover,
                       std::uint64_t seed) {
  std::size_t steps = 0;
  while (steps < Life().acknowledged.size() && Life().acknowledged[steps] <= changes) ++steps;
  const TempDir dir;
  const StoreFiles files(dir.path());
  std::mt19937_64 random(seed);
  disk.WriteImage(leftover, random, dir.path());
  // What recovery does is not tested for durability here: no need to wait for the disk.
  FaultPlan none(Fault::kAnyOnce, kEndless);
  const ObservedFiles observed(none);
  const std::string state = StateOf(files);
  const bool under_way = steps < Life().names.size();
  const std::string where = fmt::format("after change {} of {}, seed {}, {} steps acknowledged, {}",
                                        changes,
                                        Life().changes.size(),
                                        seed,
                                        steps,
                                        under_way ? Life().names[steps] : "all");
  if (state != Life().states[steps] && !(under_way && state == Life().states[steps + 1])) {
    return fmt::format("{}:\n{}expected:\n{}", where, state, Life().states[steps]);
  }
  for (const std::string& path : {files.store, files.snapshot}) {
    const std::string integrity = CheckIntegrity(path);
    if (integrity != "ok") return fmt::format("{}: {}: {}", where, path, integrity);
  }
  return "";
}

TEST(PowerLossTest, KeepsWhatWasAcknowledged) {
  const std::uint64_t base = TestSeed(11);
  const std::size_t stride = LongTests() ? 1 : 11;
  const std::uint64_t subsets = LongTests() ? 30 : 1;
  PowerLossDisk disk;
  std::size_t images = 0;
  for (std::size_t changes = 0; changes <= Life().changes.size(); ++changes) {
    if (changes > 0) disk.Apply(Life().changes[changes - 1]);
    if ((changes + base) % stride != 0) continue;
    ASSERT_EQ(CheckImage(disk, changes, Leftover::kNone, base), "");
    ASSERT_EQ(CheckImage(disk, changes, Leftover::kAll, base), "");
    for (std::uint64_t subset = 0; subset < subsets; ++subset) {
      const std::uint64_t seed = base + 1'000'003 * changes + subset;
      ASSERT_EQ(CheckImage(disk, changes, Leftover::kSome, seed), "");
    }
    images += 2 + subsets;
  }
  RecordProperty("changes", static_cast<int>(Life().changes.size()));
  RecordProperty("images", static_cast<int>(images));
}

// The test itself: it must notice a sync that is not made, so leave some out.
bool NoticesWithout(bool (*left_out)(const DiskChange&)) {
  PowerLossDisk disk;
  for (std::size_t changes = 1; changes <= Life().changes.size(); ++changes) {
    const DiskChange& change = Life().changes[changes - 1];
    if (!left_out(change)) disk.Apply(change);
    const bool acknowledges =
        std::find(Life().acknowledged.begin(), Life().acknowledged.end(), changes) !=
        Life().acknowledged.end();
    if (!acknowledges) continue;
    for (const Leftover leftover : {Leftover::kNone, Leftover::kSome}) {
      if (!CheckImage(disk, changes, leftover, changes).empty()) return true;
    }
  }
  return false;
}

TEST(PowerLossTest, NoticesMissingSyncs) {
  EXPECT_FALSE(NoticesWithout([](const DiskChange&) { return false; }));
  EXPECT_TRUE(NoticesWithout(
      [](const DiskChange& change) { return change.operation == FileOperation::kSyncFolder; }));
  EXPECT_TRUE(NoticesWithout([](const DiskChange& change) {
    return change.operation == FileOperation::kSync && change.path.ends_with("/a.db");
  }));
  EXPECT_TRUE(NoticesWithout([](const DiskChange& change) {
    return change.operation == FileOperation::kSync &&
           change.path.find("/a.snapshot.tmp") != std::string::npos;
  }));
}

}  // namespace
}  // namespace shiftmap::testing
