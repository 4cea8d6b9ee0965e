// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/store_writer.h"

#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "mapstore/sqlite/database.h"
#include "mapstore/sqlite/transaction.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::server {
namespace {

using shiftmap::testing::At;
using shiftmap::testing::EmptyReport;
using shiftmap::testing::IsOk;
using shiftmap::testing::OpenStore;
using shiftmap::testing::TempDir;
using shiftmap::testing::TwoStateContent;

// Another process holds the store while a fleet's notes of uploads and then a report come.
TEST(StoreWriter, AReportWaitsForOneNoteAtMost) {
  constexpr int kNotes = 8;
  const TempDir dir;
  const std::string path = dir.File("maps.db");
  MapStore store = OpenStore(path);
  const CommitResult version = *store.Commit("floor", TwoStateContent(1e-5, 0.5, At(1.0)), {}, {});
  StoreWriter writer(OpenStore(path), 100);
  std::vector<std::jthread> callers;
  const auto wait_for = [&](std::size_t waiting) {
    while (writer.waiting() < waiting) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  {
    Database::Options options;
    options.mode = Database::Mode::kReadWrite;
    Database database = *Database::Open(path, options);
    const auto held = Transaction::Begin(database, Transaction::Kind::kWrite);
    ASSERT_THAT(held.status(), IsOk());
    for (int i = 0; i < kNotes; ++i) {
      callers.emplace_back(
          [&] { EXPECT_THAT(writer.NoteUpload(std::string(64, 'a'), "truck"), IsOk()); });
    }
    // The first one is being written.
    wait_for(kNotes - 1);
    callers.emplace_back(
        [&] { EXPECT_THAT(writer.Return(EmptyReport(version, "floor", 1), "truck"), IsOk()); });
    wait_for(kNotes);
  }
  callers.clear();
  writer.Stop();
  int notes_before = 0;
  const std::vector<AuditEntry> audit =
      *store.AuditLog(std::nullopt, {AuditAction::kUpload, AuditAction::kReturn});
  ASSERT_EQ(audit.size(), kNotes + 1u);
  for (const AuditEntry& entry : audit) {
    if (entry.Is(AuditAction::kReturn)) break;
    ++notes_before;
  }
  EXPECT_LE(notes_before, 1);
}

}  // namespace
}  // namespace shiftmap::server
