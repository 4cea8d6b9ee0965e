// SPDX-License-Identifier: Apache-2.0
//
// The run logs that a service leaves of its shifts.
#include "localizer/live/shift_logs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

#include "mapstore/codec/run_log.h"
#include "tests/unit/localizer/live/service_fixture.h"

namespace shiftmap::live {
namespace {

using testing::IsOk;
using testing::StatusIs;

class ShiftLogsTest : public ServiceTest {
 protected:
  std::string Log(const std::string& uuid) const {
    return folder_.File("state") + "/" + uuid + ".mcap";
  }

  std::vector<std::string> FilesEndingIn(const std::string& ending) const {
    std::vector<std::string> names;
    for (const auto& file : std::filesystem::directory_iterator(folder_.File("state"))) {
      const std::string name = file.path().filename().string();
      if (name.ends_with(ending)) names.push_back(name);
    }
    return names;
  }

  // A whole shift, stopped and its log made. Returns the UUID of its report.
  std::string WholeShift(const ServiceOptions& options) {
    StatusOr<Service> service = Service::Open(options);
    EXPECT_THAT(service, IsOk());
    EXPECT_THAT(Do(&*service, Start{}), IsOk());
    Feed(&*service, 0, items_.size());
    EXPECT_THAT(Do(&*service, live::Stop()), IsOk());
    EXPECT_THAT(service->Shutdown(), IsOk());
    return service->State().report_uuid;
  }

  static void ExpectSameItems(const shiftmap::Run& run, const std::vector<RunEvent>& items) {
    const std::vector<RunEvent> logged = MergeEvents(run);
    ASSERT_EQ(logged.size(), items.size());
    for (std::size_t i = 0; i < items.size(); ++i) {
      ASSERT_EQ(StampOf(logged[i]), StampOf(items[i]));
      ASSERT_EQ(logged[i].index(), items[i].index());
      if (const auto* sample = std::get_if<OdometrySample>(&items[i])) {
        EXPECT_EQ(std::get<OdometrySample>(logged[i]).omega_radps, sample->omega_radps);
      } else if (const auto* lidar = std::get_if<LidarScan>(&items[i])) {
        EXPECT_EQ(std::get<LidarScan>(logged[i]).ranges_m, lidar->ranges_m);
      } else {
        EXPECT_EQ(std::get<Scan>(logged[i]).observations.size(),
                  std::get<Scan>(items[i]).observations.size());
      }
    }
  }
};

TEST_F(ShiftLogsTest, AShiftLeavesItsItemsUnderTheUuidOfItsReport) {
  const std::string uuid = WholeShift(Options());
  const StatusOr<RunLog> log = ReadRunLog(Log(uuid));
  ASSERT_THAT(log, IsOk());
  EXPECT_EQ(log->truncation, "");
  EXPECT_EQ(log->run.info.uuid, uuid);
  EXPECT_EQ(log->run.info.area, "area");
  EXPECT_EQ(log->run.info.vehicle, "cart");
  ExpectSameItems(log->run, items_);
  EXPECT_TRUE(FilesEndingIn(".journal").empty());
  EXPECT_TRUE(warnings_.empty());
  EXPECT_THAT(ReadShiftReport(folder_.File("state") + "/" + uuid + ".report"), IsOk());
}

// Whether the shift uses them or not.
TEST_F(ShiftLogsTest, ALidarsScansAreInTheLog) {
  AddLidarScans();
  for (const FieldOfViewModel model : {FieldOfViewModel::kSector, FieldOfViewModel::kScanPolygon}) {
    for (const double max_delay_s : {0.0, 0.5}) {
      ServiceOptions options = Options();
      options.localizer.max_delay_s = max_delay_s;
      options.localizer.hypotheses.field_of_view.model = model;
      const StatusOr<RunLog> log = ReadRunLog(Log(WholeShift(options)));
      ASSERT_THAT(log, IsOk());
      ExpectSameItems(log->run, items_);
    }
  }
  EXPECT_TRUE(warnings_.empty());
}

// Drivers deliver out of step; a log is in the order of time.
TEST_F(ShiftLogsTest, ItemsThatCameLateAreInTheirPlace) {
  const std::vector<RunEvent> in_order = items_;
  for (std::size_t i = 0; i + 3 < items_.size(); i += 3) std::swap(items_[i], items_[i + 2]);
  ServiceOptions options = Options();
  options.localizer.max_delay_s = 0.5;
  const StatusOr<RunLog> log = ReadRunLog(Log(WholeShift(options)));
  ASSERT_THAT(log, IsOk());
  ExpectSameItems(log->run, in_order);
}

TEST_F(ShiftLogsTest, AJournalThatAProcessLeftIsMadeALogByTheNext) {
  const std::string uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
  {
    Service service = Opened();
    ASSERT_THAT(Do(&service, Start{}), IsOk());
    Feed(&service, 0, items_.size());
    std::filesystem::copy_file(Journal(), folder_.File("state") + "/" + uuid + ".journal");
    ASSERT_THAT(Do(&service, live::Stop()), IsOk());
  }
  Service service = Opened();
  for (int i = 0; i < 500 && !FilesEndingIn(".journal").empty(); ++i) {
    service.SyncJournal();
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_EQ(FilesEndingIn(".mcap").size(), 2u);
  EXPECT_THAT(ReadRunLog(Log(uuid)), IsOk());
}

TEST_F(ShiftLogsTest, TheOldestLogsMakeRoom) {
  const std::string first = WholeShift(Options());
  ServiceOptions options = Options();
  options.max_log_bytes = static_cast<std::int64_t>(std::filesystem::file_size(Log(first))) * 3 / 2;
  // File systems keep the time in steps.
  std::filesystem::last_write_time(
      Log(first), std::filesystem::file_time_type::clock::now() - std::chrono::seconds(10));
  const std::string second = WholeShift(options);
  EXPECT_EQ(FilesEndingIn(".mcap"), std::vector<std::string>{second + ".mcap"});
  EXPECT_EQ(FilesEndingIn(".report").size(), 2u);
}

TEST_F(ShiftLogsTest, NoneAreKeptWithoutRoom) {
  ServiceOptions options = Options();
  options.max_log_bytes = 0;
  WholeShift(options);
  EXPECT_TRUE(FilesEndingIn(".mcap").empty());
  EXPECT_TRUE(FilesEndingIn(".journal").empty());
}

// A recording is made once the log is, and only then is the journal gone. It is no matter of the
// service's end.
TEST_F(ShiftLogsTest, ARecordingIsMadeAfterTheLogAndBoundedByItself) {
  ServiceOptions options = Options();
  const std::string recordings = folder_.File("recordings");
  std::atomic<int> made = 0;
  options.recordings = {
      recordings, 10, [&](const std::string& journal, const std::string& path, const auto&) {
        EXPECT_TRUE(std::filesystem::exists(journal));
        std::ofstream(path) << "eight by";
        ++made;
        return OkStatus();
      }};
  StatusOr<Service> service = Service::Open(options);
  ASSERT_THAT(service, IsOk());
  std::vector<std::string> uuids;
  for (int shift = 0; shift < 2; ++shift) {
    ASSERT_THAT(Do(&*service, Start{}), IsOk());
    Feed(&*service, 0, items_.size());
    ASSERT_THAT(Do(&*service, live::Stop()), IsOk());
    uuids.push_back(service->State().report_uuid);
    for (int i = 0; i < 10'000 && made <= shift; ++i) {
      service->SyncJournal();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    ASSERT_EQ(made, shift + 1);
  }
  ASSERT_THAT(service->Shutdown(), IsOk());
  EXPECT_TRUE(warnings_.empty());
  EXPECT_EQ(FilesEndingIn(".mcap").size(), 2u);
  EXPECT_TRUE(FilesEndingIn(".journal").empty());
  EXPECT_TRUE(FilesEndingIn(".unrecorded").empty());
  EXPECT_FALSE(std::filesystem::exists(recordings + "/" + uuids[0] + ".mcap"));
  EXPECT_TRUE(std::filesystem::exists(recordings + "/" + uuids[1] + ".mcap"));
}

TEST_F(ShiftLogsTest, TheEndDoesNotWaitForARecordingAndTheNextProcessMakesIt) {
  ServiceOptions options = Options();
  options.recordings = {folder_.File("recordings"),
                        1 << 20,
                        [&](const std::string&, const std::string&, const std::atomic<bool>& stop) {
                          while (!stop) std::this_thread::sleep_for(std::chrono::milliseconds(1));
                          return MakeStatus(StatusCode::kAborted, "stopped");
                        }};
  const std::string uuid = WholeShift(options);
  EXPECT_TRUE(warnings_.empty());
  EXPECT_THAT(ReadRunLog(Log(uuid)), IsOk());
  EXPECT_EQ(FilesEndingIn(".unrecorded"), std::vector<std::string>{uuid + ".unrecorded"});

  ShiftRecordings next = options.recordings;
  next.make = [](const std::string&, const std::string&, const std::atomic<bool>&) {
    return NotFound("its map");
  };
  ShiftLogs logs(folder_.File("state"), 1 << 20, next);
  Status status = OkStatus();
  for (int i = 0; i < 10'000 && status.ok(); ++i) {
    status = logs.StepCallback();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_THAT(status, StatusIs(StatusCode::kNotFound, "its map, the shift has no recording"));
  EXPECT_TRUE(FilesEndingIn(".unrecorded").empty());
}

TEST_F(ShiftLogsTest, AJournalWhoseRecordingEndedTheProcessIsNotTriedAgain) {
  std::filesystem::create_directory(folder_.File("state"));
  const std::string uuid = folder_.File("state") + "/0f8fad5b-d9cb-469f-a165-70867728950e";
  std::ofstream(uuid + ".recording") << "poison";
  std::ofstream(uuid + ".unrecorded") << "waits";
  const ShiftLogs logs(folder_.File("state"), 1 << 20, {folder_.File("recordings"), 1, nullptr});
  EXPECT_FALSE(std::filesystem::exists(uuid + ".recording"));
  EXPECT_TRUE(std::filesystem::exists(uuid + ".unrecorded"));
  // Nobody wants recordings any more.
  const ShiftLogs without(folder_.File("state"), 1 << 20);
  EXPECT_FALSE(std::filesystem::exists(uuid + ".unrecorded"));
}

// What is no journal is kept, and said once.
TEST_F(ShiftLogsTest, AJournalThatMakesNoLogIsKept) {
  std::filesystem::create_directory(folder_.File("state"));
  const std::string journal =
      folder_.File("state") + "/0f8fad5b-d9cb-469f-a165-70867728950e.journal";
  std::ofstream(journal) << "SHMJ";
  ShiftLogs logs(folder_.File("state"), 1 << 20);
  EXPECT_THAT(logs.Finish(), StatusIs(StatusCode::kDataLoss, "does not begin with"));
  EXPECT_THAT(logs.Finish(), IsOk());
  EXPECT_TRUE(std::filesystem::exists(journal));
}

}  // namespace
}  // namespace shiftmap::live
