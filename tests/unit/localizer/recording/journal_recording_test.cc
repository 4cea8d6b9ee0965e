// SPDX-License-Identifier: Apache-2.0
#include "localizer/recording/journal_recording.h"

#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <string>
#include <vector>

#include "localizer/live/codec/journal_codec.h"
#include "localizer/live/journal_file.h"
#include "localizer/live/shift.h"
#include "localizer/recording/shift_recorder.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

// The journal of a short shift.
class JournalRecordingTest : public ::testing::Test {
 protected:
  JournalRecordingTest() {
    const MapContent content = MakeTwoModeMap(25, 15.0, 3);
    map_ = Snapshot(content);
    SimulationOptions simulation;
    simulation.duration_s = 30.0;
    items_ = MergeEvents(
        Simulate(content, PositionsOf(content, std::vector<int>(25, 1)), simulation).run);
    header_.uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
    header_.vehicle = "cart";
    header_.area = map_->area();
    header_.version = map_->version();
    header_.content_hash = map_->content_hash();
    header_.map_stamp = map_->stamp();
    header_.alpha = 1e-4;
    header_.max_leaves = 16;
    auto journal = live::JournalFile::Create(journal_);
    EXPECT_THAT(journal, IsOk());
    journal->Append(live::EncodeJournalRecord(header_));
    for (const RunEvent& item : items_) {
      journal->Append(std::visit(
          [](const auto& value) { return live::EncodeJournalRecord(live::JournalRecord(value)); },
          item));
    }
    EXPECT_THAT(journal->Write(), IsOk());
  }

  Status Make(const MapSnapshot& map) {
    return RecordJournal(
        journal_,
        [&](const live::ShiftHeader&) -> StatusOr<MapSnapshot> { return map; },
        "test",
        path_,
        stop_);
  }

  testing::TempDir folder_;
  const std::string journal_ = folder_.File("shift.journal");
  const std::string path_ = folder_.File("shift.mcap");
  std::optional<MapSnapshot> map_;
  std::vector<RunEvent> items_;
  live::ShiftHeader header_;
  std::atomic<bool> stop_ = false;
};

TEST_F(JournalRecordingTest, IsTheRecordingOfTheShiftWhileItWasDriven) {
  const std::string driven = folder_.File("driven.mcap");
  live::Shift shift(*map_, header_);
  RecordedShift recorded;
  recorded.vehicle = header_.vehicle;
  recorded.run_uuid = header_.uuid;
  recorded.software = "test";
  auto recorder = ShiftRecorder::Create(
      driven, recorded, shift.localizer().snapshot(), StampOf(items_.front()));
  ASSERT_THAT(recorder, IsOk());
  std::vector<live::Event> events;
  for (const RunEvent& item : items_) {
    ASSERT_THAT(shift.Process(item, &events), IsOk());
    ASSERT_THAT(recorder->Record(shift.localizer()), IsOk());
  }
  shift.LocalizeHeld(&events);
  ASSERT_THAT(recorder->Record(shift.localizer()), IsOk());
  ASSERT_THAT(recorder->Finish(), IsOk());

  ASSERT_THAT(Make(*map_), IsOk());
  EXPECT_EQ(testing::ReadFile(path_), testing::ReadFile(driven));
  const auto recording = ReadShiftRecording(path_);
  ASSERT_THAT(recording, IsOk());
  EXPECT_EQ(recording->shift.run_uuid, header_.uuid);
  EXPECT_GT(recording->poses.size(), 20U);
}

TEST_F(JournalRecordingTest, AnotherMapIsRefusedAndAStopLeavesNothing) {
  const MapSnapshot other(map_->area(), map_->version(), "another", map_->content());
  EXPECT_THAT(Make(other), StatusIs(StatusCode::kFailedPrecondition, "content hash another"));
  stop_ = true;
  EXPECT_THAT(Make(*map_), StatusIs(StatusCode::kAborted, "stopped"));
  EXPECT_FALSE(std::filesystem::exists(path_));
}

}  // namespace
}  // namespace shiftmap
