// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/service.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>

#include "localizer/live/codec/live_codec.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/map_store.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/localizer/live/service_fixture.h"

namespace shiftmap::live {
namespace {

using testing::IsOk;
using testing::ReadFile;
using testing::StatusIs;
using testing::WriteFile;

TEST_F(ServiceTest, AShiftUsesItsVehiclesOwnCalibration) {
  std::mt19937_64 random(testing::TestSeed(5));
  content_.vehicles = {testing::RandomVehicle(random, "cart")};
  {
    auto store = MapStore::Open(store_, MapStore::Access::kReadWrite);
    ASSERT_THAT(store, IsOk());
    CommitOptions options;
    options.parent = VersionNumber(1);
    ASSERT_THAT(store->Commit("area", content_, Provenance(), options), IsOk());
  }
  {
    Service service = Opened();
    ASSERT_THAT(Do(&service, Start()), IsOk());
    EXPECT_EQ(service.State().calibrated_vehicle, "cart");
  }
  Service service = Opened();
  EXPECT_TRUE(service.State().resumed);
  EXPECT_EQ(service.State().calibrated_vehicle, "cart");
  Stop(&service);
  ASSERT_THAT(Do(&service, Start{.vehicle = "crane", .odometer_m = std::nullopt}), IsOk());
  EXPECT_EQ(service.State().calibrated_vehicle, "");
}

// Wherever the disk's content ends, what is whole is taken up, and fed on from there the shift says
// what an uninterrupted one says, under the same UUID.
TEST_F(ServiceTest, CutJournalLosesOnlyItsTail) {
  std::string journal;
  std::string expected;
  {
    Service service = Opened();
    ASSERT_THAT(Do(&service, Start()), IsOk());
    Feed(&service, 0, items_.size() / 2);
    journal = ReadFile(Journal());
    Feed(&service, items_.size() / 2, items_.size());
    expected = Stop(&service);
    EXPECT_FALSE(std::filesystem::exists(Journal()));
  }
  for (const std::size_t lost : {0u, 1u, 7u, 30u, 500u}) {
    WriteFile(Journal(), journal.substr(0, journal.size() - lost));
    Service service = Opened();
    const ServiceState state = service.State();
    ASSERT_TRUE(state.running && state.resumed);
    const auto first = std::find_if(items_.begin(), items_.end(), [&](const RunEvent& item) {
      return StampOf(item) > state.stamp;
    });
    auto next = static_cast<std::size_t>(first - items_.begin());
    // Odometry and scan of one stamp are two items: the second may be missing.
    if (lost == 0) next = items_.size() / 2;
    if (lost != 0 && next > 0 && StampOf(items_[next - 1]) == state.stamp &&
        std::holds_alternative<Scan>(items_[next - 1])) {
      const std::int64_t scans = std::count_if(
          items_.begin(), first, [](const auto& e) { return std::holds_alternative<Scan>(e); });
      if (state.scans < scans) --next;
    }
    Feed(&service, next, items_.size());
    EXPECT_TRUE(Stop(&service) == expected) << lost << " bytes lost";
  }
}

// Items that come late by less than the bound, and a crash in between: what is held then is in the
// journal, and the report says what it says without either.
TEST_F(ServiceTest, LateItemsAndACrashChangeNothing) {
  const auto delayed_by = [&](double max_delay_s) {
    ServiceOptions options = Options();
    options.localizer.max_delay_s = max_delay_s;
    return options;
  };
  const auto said = [&](Service* service) {
    EXPECT_THAT(Do(service, live::Stop()), IsOk());
    auto report = ReadShiftReport(service->State().report_path);
    EXPECT_THAT(report, IsOk());
    report->uuid.clear();
    return EncodeShiftReport(*report);
  };
  std::string expected;
  {
    StatusOr<Service> service = Service::Open(delayed_by(0.0));
    ASSERT_THAT(service, IsOk());
    ASSERT_THAT(Do(&*service, Start()), IsOk());
    Feed(&*service, 0, items_.size());
    expected = said(&*service);
  }
  // Every odometry sample comes after the two that follow it.
  for (std::size_t i = 0; i + 2 < items_.size(); i += 3) {
    if (StampOf(items_[i]) == StampOf(items_[i + 1])) continue;
    std::rotate(items_.begin() + static_cast<std::ptrdiff_t>(i),
                items_.begin() + static_cast<std::ptrdiff_t>(i) + 1,
                items_.begin() + static_cast<std::ptrdiff_t>(i) + 3);
  }
  const std::size_t crash = items_.size() / 2;
  {
    StatusOr<Service> service = Service::Open(delayed_by(0.2));
    ASSERT_THAT(service, IsOk());
    ASSERT_THAT(Do(&*service, Start()), IsOk());
    Feed(&*service, 0, crash);
  }
  StatusOr<Service> service = Service::Open(delayed_by(0.0));
  ASSERT_THAT(service, IsOk());
  ASSERT_TRUE(service->State().resumed);
  Feed(&*service, crash, items_.size());
  EXPECT_TRUE(said(&*service) == expected);
}

// The header of the journal keeps the model, and the journal the lidar's scans.
TEST_F(ServiceTest, AShiftByScanPolygonIsResumedByIt) {
  AddLidarScans();
  const std::size_t crash = items_.size() / 2;
  const auto report_of = [&](FieldOfViewModel model, bool crashes) {
    ServiceOptions options = Options();
    options.localizer.hypotheses.field_of_view.model = model;
    const auto begin = [&](std::size_t end) {
      StatusOr<Service> service = Service::Open(options);
      EXPECT_THAT(service, IsOk());
      EXPECT_THAT(Do(&*service, Start()), IsOk());
      Feed(&*service, 0, end);
      return *std::move(service);
    };
    if (crashes) begin(crash);
    // Of a service whose next shift is by the sector.
    Service service = crashes ? Opened() : begin(items_.size());
    EXPECT_EQ(service.State().resumed, crashes);
    if (crashes) Feed(&service, crash, items_.size());
    EXPECT_THAT(Do(&service, live::Stop()), IsOk());
    auto report = ReadShiftReport(service.State().report_path);
    EXPECT_THAT(report, IsOk());
    report->uuid.clear();
    return EncodeShiftReport(*report);
  };
  const std::string polygon = report_of(FieldOfViewModel::kScanPolygon, false);
  EXPECT_TRUE(report_of(FieldOfViewModel::kScanPolygon, true) == polygon);
  // Most landmarks are beyond the walls, and that they are missed says nothing.
  EXPECT_FALSE(report_of(FieldOfViewModel::kSector, false) == polygon);
}

// What is held is localized once no item has come for as long as one may be late, and the report
// says what it says without the pause.
TEST_F(ServiceTest, APauseOfTheStreamKeepsNothingWaiting) {
  ServiceOptions options = Options();
  options.localizer.max_delay_s = 0.2;
  // Up to a scan, which is held.
  std::size_t half = items_.size() / 2;
  while (!std::holds_alternative<Scan>(items_[half - 1])) ++half;
  std::string expected;
  for (const bool pauses : {false, true}) {
    StatusOr<Service> service = Service::Open(options);
    ASSERT_THAT(service, IsOk());
    ASSERT_THAT(Do(&*service, Start()), IsOk());
    EXPECT_FALSE(service->held_until());
    Feed(&*service, 0, half);
    if (pauses) {
      const std::int64_t scans = service->State().scans;
      ASSERT_TRUE(service->held_until());
      service->LocalizeHeld(*service->held_until() - std::chrono::milliseconds(1), &events_);
      EXPECT_EQ(service->State().scans, scans);
      service->LocalizeHeld(*service->held_until(), &events_);
      const std::int64_t fed = std::count_if(
          items_.begin(), items_.begin() + static_cast<std::ptrdiff_t>(half), [](const auto& item) {
            return std::holds_alternative<Scan>(item);
          });
      EXPECT_EQ(service->State().scans, fed);
      EXPECT_GT(fed, scans);
      EXPECT_FALSE(service->held_until());
    }
    Feed(&*service, half, items_.size());
    EXPECT_THAT(Do(&*service, live::Stop()), IsOk());
    auto report = ReadShiftReport(service->State().report_path);
    ASSERT_THAT(report, IsOk());
    report->uuid.clear();
    if (pauses) {
      EXPECT_TRUE(EncodeShiftReport(*report) == expected);
    } else {
      expected = EncodeShiftReport(*report);
    }
  }
}

TEST_F(ServiceTest, SaysWhatItBelieves) {
  Service service = Opened();
  const Request ask{.id = 7, .command = GetState{.hypotheses = true}};
  EXPECT_FALSE(service.Handle(ask, &events_).hypotheses);
  ASSERT_THAT(Do(&service, Start()), IsOk());
  Feed(&service, 0, items_.size());
  const Reply reply = service.Handle(ask, &events_);
  ASSERT_TRUE(reply.hypotheses);
  EXPECT_NEAR(reply.hypotheses->nodes[0].probability, 1.0, 1e-6);
  EXPECT_FALSE(reply.hypotheses->visits.empty());
  EXPECT_FALSE(service.Handle({.id = 8, .command = GetState()}, &events_).hypotheses);
  EXPECT_FALSE(service.Handle({.id = 0, .command = ask.command}, &events_).hypotheses);

  const std::string bytes = EncodeEvent(reply);
  const auto decoded = DecodeEvent(bytes);
  ASSERT_THAT(decoded, IsOk());
  EXPECT_TRUE(EncodeEvent(*decoded) == bytes);
}

TEST_F(ServiceTest, WhatIsTooLateIsCounted) {
  Service service = Opened();
  ASSERT_THAT(Do(&service, Start()), IsOk());
  Feed(&service, 0, 20);
  const OdometrySample late{StampOf(items_[0]) - std::chrono::seconds(1), 0.0, 0.0};
  EXPECT_THAT(Do(&service, late), StatusIs(StatusCode::kInvalidArgument, "time order"));
  const ServiceState state = service.State();
  ASSERT_EQ(state.dropped.size(), 1u);
  EXPECT_EQ(state.dropped[0].reason, "late");
  EXPECT_EQ(state.dropped[0].count, 1);
}

TEST_F(ServiceTest, AStampFarAheadMakesNothingLate) {
  ServiceOptions options = Options();
  options.localizer.max_delay_s = 0.2;
  StatusOr<Service> service = Service::Open(options);
  ASSERT_THAT(service, IsOk());
  ASSERT_THAT(Do(&*service, Start()), IsOk());
  Feed(&*service, 0, 50);
  const OdometrySample ahead{StampFromSeconds(1e6), 0.0, 0.0};
  EXPECT_THAT(Do(&*service, ahead), StatusIs(StatusCode::kInvalidArgument, "expected at most"));
  const OdometrySample within_clock{StampFromSeconds(1900.0), 0.0, 0.0};
  EXPECT_THAT(Do(&*service, within_clock), IsOk());
  Feed(&*service, 50, items_.size());
}

TEST_F(ServiceTest, JournalThatDoesNotFitIsKeptAside) {
  {
    Service service = Opened();
    ASSERT_THAT(Do(&service, Start()), IsOk());
    Feed(&service, 0, 50);
  }
  MapContent other = MakeTwoModeMap(30, 20.0, 4);
  std::filesystem::remove(store_);
  auto store = MapStore::Open(store_, MapStore::Access::kReadWriteCreate);
  ASSERT_THAT(store->Commit("area", other, Provenance(), CommitOptions()), IsOk());
  Service service = Opened();
  EXPECT_FALSE(service.State().running);
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_NE(warnings_[0].find("content hash"), std::string::npos) << warnings_[0];
  int kept = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder_.File("state"))) {
    if (entry.path().filename().string().starts_with("interrupted-")) ++kept;
  }
  EXPECT_EQ(kept, 1);
  EXPECT_THAT(Do(&service, Start()), IsOk());
}

TEST_F(ServiceTest, DamagedOrForeignJournalStopsNobody) {
  std::filesystem::create_directory(folder_.File("state"));
  for (const std::string& text : {std::string("no journal"), std::string()}) {
    WriteFile(Journal(), text);
    Service service = Opened();
    EXPECT_FALSE(service.State().running);
    EXPECT_THAT(Do(&service, Start()), IsOk());
    EXPECT_THAT(Do(&service, live::Stop()), IsOk());
  }
  EXPECT_EQ(warnings_.size(), 2u);
}

TEST_F(ServiceTest, PoseThatSomebodyKnowsIsTheStart) {
  Service service = Opened();
  InitializePose start;
  start.pose = {Se2(0.0, 0.0, 0.0), Eigen::Vector3d(0.01, 0.01, 0.01).asDiagonal()};
  ASSERT_THAT(Do(&service, start), IsOk());
  ASSERT_THAT(Do(&service, Start()), IsOk());
  Feed(&service, 0, 3);
  EXPECT_NE(service.State().localizer_state, LocalizerState::kInitializing);
  Feed(&service, 3, 100);
  start.pose.T_map_vehicle = Se2(5.0, 5.0, 1.0);
  ASSERT_THAT(Do(&service, start), IsOk());
  std::size_t next = 100;
  while (!std::holds_alternative<Scan>(items_[next])) ++next;
  Feed(&service, 100, next + 1);
  EXPECT_LT((service.State().pose->T_map_vehicle.translation() - Eigen::Vector2d(5.0, 5.0)).norm(),
            1.0);
}

TEST_F(ServiceTest, StateFolderIsForOneProcess) {
  const Service service = Opened();
  EXPECT_THAT(Service::Open(Options()), StatusIs(StatusCode::kUnavailable, "in use"));
}

TEST_F(ServiceTest, OverrunsAreCounted) {
  ServiceOptions options = Options();
  options.step_budget_ms = 1e-9;
  StatusOr<Service> service = Service::Open(options);
  ASSERT_THAT(service, IsOk());
  ASSERT_THAT(Do(&*service, Start()), IsOk());
  Feed(&*service, 0, 20);
  EXPECT_EQ(service->State().overruns, 20);
}

}  // namespace
}  // namespace shiftmap::live
