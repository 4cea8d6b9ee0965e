// SPDX-License-Identifier: Apache-2.0
//
// Any request to the file system fails, in every way: what the call said, and what the store
// holds afterwards, must agree.
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <tuple>
#include <vector>

#include "proto/core/check.h"
#include "tests/fault/fault_plan.h"
#include "tests/fault/store_steps.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

// Far above the requests of any step.
constexpr int kEndless = 100'000;

// Runs without faults, and without waiting for the disk.
template <typename Function>
auto WithoutFaults(const Function& function) {
  FaultPlan none(Fault::kAnyOnce, kEndless);
  const ObservedFiles observed(none);
  return function();
}

// A step of the store's life, the files it finds, and the states before and after it.
struct Episode {
  StoreStep step;
  std::vector<std::pair<std::string, std::string>> files;  // Name, bytes.
  std::string before;
  std::string after;
};

std::vector<Episode> MakeEpisodes() {
  std::vector<Episode> episodes;
  const TempDir dir;
  const StoreFiles files(dir.path());
  for (const StoreStep& step : StoreLife()) {
    Episode episode{.step = step, .files = {}, .before = StateOf(files), .after = {}};
    for (const auto& entry : std::filesystem::directory_iterator(dir.path())) {
      episode.files.emplace_back(entry.path().filename(), ReadFile(entry.path()));
    }
    const Status status = step.run(files);
    SHIFTMAP_CHECK(status.ok(), "{}: {}", step.name, Message(status));
    episode.after = StateOf(files);
    episodes.push_back(std::move(episode));
  }
  return episodes;
}

const std::vector<Episode>& Episodes() {
  static const std::vector<Episode> episodes = WithoutFaults(MakeEpisodes);
  return episodes;
}

class IoFaultTest : public ::testing::TestWithParam<std::tuple<int, Fault>> {
 protected:
  const Episode& episode() const {
    return Episodes()[static_cast<std::size_t>(std::get<0>(GetParam()))];
  }

  // Runs the step with its n-th request failing. False if it does not make as many.
  bool RunWithFault(int n) {
    const TempDir dir;
    const StoreFiles files(dir.path());
    for (const auto& [name, bytes] : episode().files) WriteFile(dir.File(name), bytes);
    FaultPlan plan(std::get<1>(GetParam()), n);
    Status status;
    {
      const ObservedFiles observed(plan);
      status = episode().step.run(files);
    }
    if (!status.ok()) {
      EXPECT_EQ(status.code(), StatusCode::kUnavailable) << Message(status);
    }
    WithoutFaults([&] { Check(files, status); });
    return plan.fired();
  }

  // Of the calls that make many requests, the short form lets only some fail.
  int ShortStride() const {
    const std::string& name = episode().step.name;
    if (name.starts_with("Export")) return 97;
    return name == "Compact" ? 41 : 11;
  }

  void Check(const StoreFiles& files, const Status& status) {
    for (const auto& entry :
         std::filesystem::directory_iterator(std::filesystem::path(files.store).parent_path())) {
      EXPECT_EQ(entry.path().string().find(".tmp"), std::string::npos) << entry.path();
    }
    const std::string state = StateOf(files);
    EXPECT_EQ(CheckIntegrity(files.store), "ok");
    EXPECT_EQ(CheckIntegrity(files.snapshot), "ok");
    if (status.ok()) {
      EXPECT_EQ(state, episode().after);
      return;
    }
    EXPECT_TRUE(state == episode().before || state == episode().after) << Message(status) << "\n"
                                                                       << state << "before:\n"
                                                                       << episode().before;
    // What was refused can be done later; a report also when it was kept after all.
    const bool repeatable = episode().step.name.starts_with("Return");
    if (state != episode().after || repeatable) {
      EXPECT_THAT(episode().step.run(files), IsOk());
      EXPECT_EQ(StateOf(files), episode().after);
    }
  }
};

TEST_P(IoFaultTest, EitherOldOrNewState) {
  const int stride = LongTests() ? 1 : ShortStride();
  int n = 1;
  for (; n < kEndless; n += stride) {
    SCOPED_TRACE(fmt::format("request {} fails", n));
    if (!RunWithFault(n)) break;
    ASSERT_FALSE(HasFailure());
  }
  EXPECT_LT(n, kEndless);
  RecordProperty("requests", n - 1);
}

INSTANTIATE_TEST_SUITE_P(Steps,
                         IoFaultTest,
                         ::testing::Combine(::testing::Range(0,
                                                             static_cast<int>(StoreLife().size())),
                                            ::testing::Values(Fault::kAnyOnce,
                                                              Fault::kAnyFromThen,
                                                              Fault::kDiskFull,
                                                              Fault::kStaysFull,
                                                              Fault::kReadOnlyDisk)),
                         [](const auto& test) {
                           const auto step = static_cast<std::size_t>(std::get<0>(test.param));
                           return StoreLife()[step].name + NameOf(std::get<1>(test.param));
                         });

// A program that goes on with the object whose call failed.
TEST(IoFaultObjectTest, ObjectGoesOnAfterAnError) {
  for (int n = 1; n < kEndless; ++n) {
    SCOPED_TRACE(fmt::format("request {} fails", n));
    const TempDir dir;
    const StoreFiles files(dir.path());
    for (const auto& [name, bytes] : Episodes()[3].files) WriteFile(dir.File(name), bytes);
    FaultPlan plan(Fault::kAnyFromThen, n);
    const ObservedFiles observed(plan);
    FaultPlan* const faults = &plan;
    StatusOr<MapStore> store = MapStore::Open(files.store, MapStore::Access::kReadWrite);
    if (!store.ok()) continue;
    const StatusOr<MapSnapshot> map = store->LoadAt("mine");
    if (!map.ok()) continue;
    const ShiftReport report = SmallReport(*map, 2);
    const StatusOr<ReturnResult> first = store->Return(report);
    if (!plan.fired()) {
      EXPECT_THAT(first, IsOk());
      break;
    }
    faults->Stop();
    const StatusOr<ReturnResult> second = store->Return(report);
    ASSERT_THAT(second, IsOk());
    EXPECT_TRUE(!first.ok() || second->duplicate);
    EXPECT_EQ(StateOf(files), Episodes()[3].after);
  }
}

}  // namespace
}  // namespace shiftmap::testing
