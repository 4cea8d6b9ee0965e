// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/night_lock.h"

#include <gtest/gtest.h>

#include <fstream>
#include <optional>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

using testing::StatusIs;

class NightLockTest : public ::testing::Test {
 protected:
  // A night of its own; one that does not end is interrupted.
  std::optional<Stamp> Night(int seconds, bool ends) {
    NightLock lock = *NightLock::Take(store_);
    const StatusOr<std::optional<Stamp>> interrupted = lock.Begin(At(seconds));
    EXPECT_TRUE(interrupted.ok()) << interrupted.status();
    if (ends) lock.End();
    return interrupted.value_or(std::nullopt);
  }

  static Stamp At(int seconds) { return Stamp(std::chrono::seconds(seconds)); }

  testing::TempDir dir_;
  std::string store_ = dir_.File("a.db");
};

TEST_F(NightLockTest, IsOfOneNight) {
  const StatusOr<NightLock> lock = NightLock::Take(store_);
  ASSERT_TRUE(lock.ok());
  EXPECT_THAT(NightLock::Take(store_).status(),
              StatusIs(StatusCode::kUnavailable, "another night is under way"));
}

TEST_F(NightLockTest, KnowsTheFirstOfTheNightsThatWereInterrupted) {
  EXPECT_EQ(Night(10, true), std::nullopt);
  EXPECT_EQ(Night(20, false), std::nullopt);
  EXPECT_EQ(Night(30, false), At(20));
  EXPECT_EQ(Night(40, true), At(20));
  EXPECT_EQ(Night(50, true), std::nullopt);
}

TEST_F(NightLockTest, AFileOfSomethingElseIsOfNoNight) {
  std::ofstream(store_ + ".nightly") << "Monday\n" << std::string(100, '7');
  EXPECT_EQ(Night(10, false), std::nullopt);
  EXPECT_EQ(Night(20, true), At(10));
}

}  // namespace
}  // namespace shiftmap
