// SPDX-License-Identifier: Apache-2.0
//
// One writer at a time: who must wait says so, and gives up in time.
#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <thread>

#include "mapstore/map_store.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/sqlite/transaction.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::testing {
namespace {

using std::chrono::milliseconds;

class LockTest : public ::testing::Test {
 protected:
  LockTest() { OpenStore(path_); }

  Database OpenRaw() {
    Database::Options options;
    options.mode = Database::Mode::kReadWrite;
    return *Database::Open(path_, options);
  }

  MapStore OpenWaiting(milliseconds timeout) {
    MapStore::OpenOptions options;
    options.access = MapStore::Access::kReadWrite;
    options.lock_timeout = timeout;
    options.on_wait = [this] { ++told_; };
    return *MapStore::Open(path_, options);
  }

  TempDir dir_;
  const std::string path_ = dir_.File("a.db");
  int told_ = 0;
};

TEST_F(LockTest, WriterThatWaitsInVainSaysSoAndChangesNothing) {
  MapStore store = OpenWaiting(milliseconds(400));
  Database other = OpenRaw();
  {
    const Transaction held = *Transaction::Begin(other, Transaction::Kind::kWrite);
    EXPECT_THAT(store.Commit("a", TwoStateContent(1e-3, 0.7, At(0.0)), {}, {}),
                StatusIs(StatusCode::kUnavailable, "map store '" + path_ + "'"));
    EXPECT_EQ(told_, 1);
    // Readers are not kept from reading what is there.
    EXPECT_TRUE(MapStore::Open(path_, MapStore::Access::kReadOnly)->Areas()->empty());
  }
  EXPECT_THAT(store.Commit("a", TwoStateContent(1e-3, 0.7, At(0.0)), {}, {}), IsOk());
  EXPECT_EQ(told_, 1);
}

TEST_F(LockTest, WriterGoesOnOnceTheOtherIsDone) {
  MapStore store = OpenWaiting(milliseconds(20'000));
  Database other = OpenRaw();
  StatusOr<Transaction> held = Transaction::Begin(other, Transaction::Kind::kWrite);
  ASSERT_THAT(held, IsOk());
  std::thread release([&] {
    std::this_thread::sleep_for(milliseconds(500));
    EXPECT_THAT(held->Commit(), IsOk());
  });
  EXPECT_THAT(store.Commit("a", TwoStateContent(1e-3, 0.7, At(0.0)), {}, {}), IsOk());
  EXPECT_EQ(told_, 1);
  release.join();
}

}  // namespace
}  // namespace shiftmap::testing
