// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "localizer/live/service.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/map_store.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap::live {

/// A service on a map of 30 landmarks, and half a minute of a shift there.
class ServiceTest : public ::testing::Test {
 protected:
  ServiceTest() : store_(folder_.File("maps.db")), content_(MakeTwoModeMap(30, 20.0, 3)) {
    auto store = MapStore::Open(store_, MapStore::Access::kReadWriteCreate);
    EXPECT_THAT(store, testing::IsOk());
    Provenance provenance;
    EXPECT_THAT(store->Commit("area", content_, provenance, CommitOptions()), testing::IsOk());
    SimulationOptions simulation;
    simulation.duration_s = 30.0;
    items_ = MergeEvents(
        Simulate(content_, PositionsOf(content_, std::vector<int>(30, 1)), simulation).run);
  }

  ServiceOptions Options() {
    ServiceOptions options;
    options.map_path = store_;
    options.area = "area";
    options.state_dir = folder_.File("state");
    options.vehicle = "cart";
    options.software = "test";
    options.clock = [] { return StampFromSeconds(2000.0); };
    options.warn = [this](const std::string& message) { warnings_.push_back(message); };
    return options;
  }

  Service Opened() {
    StatusOr<Service> service = Service::Open(Options());
    EXPECT_THAT(service, testing::IsOk());
    return *std::move(service);
  }

  Status Do(Service* service, const Command& command) {
    events_.clear();
    return service->Handle({.id = 1, .command = command}, &events_).status;
  }

  void Feed(Service* service, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const auto command = std::visit([](const auto& item) { return Command(item); }, items_[i]);
      ASSERT_THAT(Do(service, command), testing::IsOk());
    }
    service->WriteJournal();
  }

  std::string Stop(Service* service) {
    EXPECT_THAT(Do(service, live::Stop()), testing::IsOk());
    const auto report = ReadShiftReport(service->State().report_path);
    EXPECT_THAT(report, testing::IsOk());
    return EncodeShiftReport(*report);
  }

  // Puts a lidar's scan before every third scan of the shift: walls all round, at 4 m.
  void AddLidarScans() {
    std::vector<RunEvent> items;
    int scans = 0;
    for (RunEvent& item : items_) {
      if (std::holds_alternative<Scan>(item) && scans++ % 3 == 0) {
        LidarScan lidar{StampOf(item), {.field_of_view_rad = 6.2}, {}};
        lidar.ranges_m.assign(300, 4.0f);
        items.emplace_back(std::move(lidar));
      }
      items.push_back(std::move(item));
    }
    items_ = std::move(items);
  }

  std::string Journal() const { return folder_.File("state") + "/shift.journal"; }

  testing::TempDir folder_;
  std::string store_;
  MapContent content_;
  std::vector<RunEvent> items_;
  std::vector<std::string> warnings_;
  std::vector<Event> events_;
};

}  // namespace shiftmap::live
