// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/take_over.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::testing {
namespace {

using ::testing::SizeIs;

// While a night judges in a copy, the report of a run may come, or somebody may decide about it.
TEST(TakeOver, ARunThatTheStoreHoldsMeanwhileStaysAsItIs) {
  const TempDir dir;
  MapStore store = OpenStore(dir.File("maps.db"));
  const CommitResult map = *store.Commit("a", TwoStateContent(1e-6, 0.9, At(0.0)), {}, {});
  AreaBase base;
  base.published = base.newest = map.version;
  base.audit = store.AuditLog("a")->size();
  std::filesystem::copy_file(dir.File("maps.db"), dir.File("copy.db"));
  MapStore copy = OpenStore(dir.File("copy.db"));
  for (const char digit : {'1', '2'}) {
    ASSERT_THAT(copy.Exclude("a", {std::string(64, digit), "", {}, "by the night", true, {}}),
                IsOk());
  }
  ASSERT_THAT(store.Exclude("a", {std::string(64, '1'), "", {}, "by its report", true, {}}),
              IsOk());

  ASSERT_THAT(TakeOver("a", base, &copy, &store), IsOk());
  const std::vector<Exclusion> held = *store.Exclusions("a");
  ASSERT_THAT(held, SizeIs(2));
  EXPECT_EQ(held[0].reason, "by its report");
  EXPECT_EQ(held[1].reason, "by the night");
}

}  // namespace
}  // namespace shiftmap::testing
