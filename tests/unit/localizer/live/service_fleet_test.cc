// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <filesystem>
#include <random>

#include "tests/unit/localizer/live/service_fixture.h"

namespace shiftmap::live {
namespace {

// A service on a folder with two snapshots of the area's map and one of another area.
class ServiceFleetTest : public ServiceTest {
 protected:
  ServiceFleetTest() {
    first_ = Snapshot("area", "first.db");
    auto store = MapStore::Open(store_, MapStore::Access::kReadWrite);
    EXPECT_THAT(store, testing::IsOk());
    content_.groups[0].probabilities = Eigen::Vector3d(0.05, 0.9, 0.05);
    CommitOptions options;
    options.parent = VersionNumber(1);
    EXPECT_THAT(store->Commit("area", content_, Provenance(), options), testing::IsOk());
    EXPECT_THAT(store->Commit("hall", content_, Provenance(), CommitOptions()), testing::IsOk());
    second_ = Snapshot("area", "second.db");
    hall_ = Snapshot("hall", "hall.db");
    auto folder = MapFolder::Open(folder_.File("maps"));
    EXPECT_THAT(folder, testing::IsOk());
    folder_of_maps_.emplace(*std::move(folder));
  }

  std::string Snapshot(const std::string& area, const std::string& name) {
    auto store = MapStore::Open(store_, MapStore::Access::kReadOnly);
    EXPECT_THAT(store, testing::IsOk());
    EXPECT_THAT(store->ExportSnapshot(area, folder_.File(name)), testing::IsOk());
    return folder_.File(name);
  }

  FolderMap Added(const std::string& file) {
    const auto map = folder_of_maps_->Add(file);
    EXPECT_THAT(map, testing::IsOk());
    return map.ok() ? *map : FolderMap();
  }

  Service Opened() {
    ServiceOptions options = Options();
    options.map_path.clear();
    options.map_folder = folder_.File("maps");
    options.has_map_owner = has_map_owner_;
    options.steady_clock = [] { return std::chrono::steady_clock::time_point(); };
    StatusOr<Service> service = Service::Open(options);
    EXPECT_THAT(service, testing::IsOk());
    return *std::move(service);
  }

  FleetState Fleet(Service* service) {
    events_.clear();
    const Reply reply = service->Handle({.id = 1, .command = GetFleetState()}, &events_);
    EXPECT_TRUE(reply.fleet_state.has_value());
    return reply.fleet_state.value_or(FleetState());
  }

  static ActionState Action(const FleetState& state, const std::string& id) {
    for (const ActionState& action : state.actions) {
      if (action.action_id == id) return action;
    }
    return {};
  }

  static std::vector<std::string> Errors(const FleetState& state) {
    std::vector<std::string> types;
    for (const FleetError& error : state.errors) types.push_back(error.type + " " + error.level);
    return types;
  }

  static std::string Enabled(const FleetState& state, const std::string& map_id) {
    for (const FleetState::Map& map : state.maps) {
      if (map.enabled && map.map_id == map_id) return map.map_version;
    }
    return "";
  }

  // Odometry of a vehicle that stands, after the items fed.
  void Stand(Service* service, Stamp from) {
    for (int i = 1; i <= 20; ++i) {
      ASSERT_THAT(Do(service, OdometrySample{from + FromSeconds(0.05 * i), 0.0, 0.0}),
                  testing::IsOk());
    }
  }

  EnableMap Enable(const std::string& id, const FolderMap& map) {
    return EnableMap{{id, map.map_id, map.map_version}};
  }

  DownloadMap Download(const std::string& id, const std::string& version = "1-0-0") {
    return DownloadMap{{id, "area", version}, "https://maps/a.db", ""};
  }

  std::string first_;
  std::string second_;
  std::string hall_;
  std::optional<MapFolder> folder_of_maps_;
  bool has_map_owner_ = false;
};

constexpr const char* kNotLocalized = "LOCALIZATION_ERROR FATAL";

TEST_F(ServiceFleetTest, WithoutAMapNoShiftBeginsUntilOneIsEnabled) {
  Service service = Opened();
  EXPECT_EQ(Do(&service, Start()).code(), StatusCode::kNotFound);
  const FleetState state = Fleet(&service);
  EXPECT_TRUE(state.maps.empty());
  EXPECT_FALSE(state.localized);
  EXPECT_EQ(state.map_id, "area");
  EXPECT_EQ(Errors(state), std::vector<std::string>{kNotLocalized});
  const FolderMap map = Added(first_);
  EXPECT_THAT(Do(&service, Enable("e", map)), testing::IsOk());
  EXPECT_EQ(Action(Fleet(&service), "e").status, ActionStatus::kFinished);
  EXPECT_THAT(Do(&service, Start()), testing::IsOk());
}

TEST_F(ServiceFleetTest, MapIsTakenAtOnceAtTheSamePoseWhenTheVehicleStands) {
  const FolderMap first = Added(first_);
  const FolderMap second = Added(second_);
  Service service = Opened();
  ASSERT_THAT(Do(&service, Enable("e1", first)), testing::IsOk());
  ASSERT_THAT(Do(&service, Start()), testing::IsOk());
  const std::size_t half = items_.size() / 2;
  Feed(&service, 0, half);
  Stand(&service, StampOf(items_[half - 1]));
  const FleetState before = Fleet(&service);
  ASSERT_TRUE(before.localized);
  EXPECT_GT(before.deviation_range_m.value_or(0.0), 0.0);
  const std::string uuid = service.State().report_uuid;
  ASSERT_THAT(Do(&service, Enable("e2", second)), testing::IsOk());
  EXPECT_EQ(Action(Fleet(&service), "e2").status, ActionStatus::kFinished);
  EXPECT_EQ(Enabled(Fleet(&service), "area"), second.map_version);
  const ServiceState after = service.State();
  EXPECT_TRUE(after.running);
  EXPECT_EQ(after.version, VersionNumber(2));
  EXPECT_NE(after.report_uuid, uuid);
  EXPECT_TRUE(std::filesystem::exists(folder_.File("state/" + uuid + ".report")));
  // It is localized again from the next scan on, where it was.
  Scan scan;
  for (std::size_t i = half; i-- > 0 && scan.observations.empty();) {
    if (std::holds_alternative<Scan>(items_[i])) scan = std::get<Scan>(items_[i]);
  }
  scan.stamp = StampOf(items_[half - 1]) + FromSeconds(1.1);
  ASSERT_THAT(Do(&service, scan), testing::IsOk());
  const FleetState again = Fleet(&service);
  ASSERT_TRUE(again.localized);
  EXPECT_LT((again.T_map_vehicle->translation() - before.T_map_vehicle->translation()).norm(), 0.3);
}

TEST_F(ServiceFleetTest, MapWaitsWhileTheVehicleDrivesAndTheLastOneAskedForCounts) {
  const FolderMap first = Added(first_);
  const FolderMap second = Added(second_);
  Service service = Opened();
  ASSERT_THAT(Do(&service, Enable("e1", first)), testing::IsOk());
  ASSERT_THAT(Do(&service, Start()), testing::IsOk());
  Feed(&service, 0, items_.size() / 2);
  const std::string uuid = service.State().report_uuid;
  EXPECT_THAT(Do(&service, Enable("e2", second)), testing::IsOk());
  service.StepCallback(&events_);
  EXPECT_EQ(Action(Fleet(&service), "e2").status, ActionStatus::kWaiting);
  EXPECT_EQ(Enabled(Fleet(&service), "area"), first.map_version);
  EXPECT_EQ(service.State().report_uuid, uuid);
  EXPECT_THAT(Do(&service, Enable("e3", second)), testing::IsOk());
  EXPECT_EQ(Action(Fleet(&service), "e2").status, ActionStatus::kFailed);
  // Its own map again takes back what waited.
  EXPECT_THAT(Do(&service, Enable("e4", first)), testing::IsOk());
  EXPECT_EQ(Action(Fleet(&service), "e3").status, ActionStatus::kFailed);
  EXPECT_THAT(Do(&service, Enable("e5", second)), testing::IsOk());
  ASSERT_THAT(Do(&service, live::Stop()), testing::IsOk());
  service.StepCallback(&events_);
  EXPECT_EQ(Action(Fleet(&service), "e5").status, ActionStatus::kFinished);
  EXPECT_EQ(Enabled(Fleet(&service), "area"), second.map_version);
  EXPECT_EQ(service.State().version, VersionNumber(2));
}

TEST_F(ServiceFleetTest, DownloadIsHandedOverOneByOneAndFailsWithoutADownloader) {
  Service service = Opened();
  EXPECT_EQ(Do(&service, Download("d0")).code(), StatusCode::kUnavailable);
  EXPECT_NE(Action(Fleet(&service), "d0").result.find("downloader"), std::string::npos);
  service.SetDownloader(true);
  ASSERT_THAT(Do(&service, Download("d1", "1-a-a")), testing::IsOk());
  ASSERT_EQ(events_.size(), 1u);
  EXPECT_EQ(std::get<DownloadMap>(events_[0]).action_id, "d1");
  ASSERT_THAT(Do(&service, Download("d2", "1-b-b")), testing::IsOk());
  EXPECT_TRUE(events_.empty());
  EXPECT_EQ(Action(Fleet(&service), "d1").status, ActionStatus::kInitializing);
  EXPECT_EQ(Action(Fleet(&service), "d2").status, ActionStatus::kWaiting);
  ASSERT_THAT(Do(&service, MapDownloadProgress{"d1", false, OkStatus()}), testing::IsOk());
  EXPECT_EQ(Action(Fleet(&service), "d1").status, ActionStatus::kRunning);
  ASSERT_THAT(Do(&service, MapDownloadProgress{"d1", true, OkStatus()}), testing::IsOk());
  ASSERT_EQ(events_.size(), 1u);
  EXPECT_EQ(std::get<DownloadMap>(events_[0]).action_id, "d2");
  EXPECT_EQ(Action(Fleet(&service), "d1").status, ActionStatus::kFinished);
  EXPECT_EQ(Do(&service, MapDownloadProgress{"d1", true, OkStatus()}).code(),
            StatusCode::kNotFound);
  service.SetDownloader(false);
  EXPECT_EQ(Action(Fleet(&service), "d2").status, ActionStatus::kFailed);
}

TEST_F(ServiceFleetTest, MapThatIsThereIsADuplicateUntilAnotherActionIsAccepted) {
  const FolderMap map = Added(first_);
  Service service = Opened();
  service.SetDownloader(true);
  EXPECT_EQ(Do(&service, Download("d1", map.map_version)).code(), StatusCode::kAlreadyExists);
  const FleetState state = Fleet(&service);
  EXPECT_EQ(Errors(state), (std::vector<std::string>{"DUPLICATE_MAP WARNING", kNotLocalized}));
  EXPECT_EQ(state.errors[0].references,
            (std::vector<std::pair<std::string, std::string>>{{"mapId", "area"},
                                                              {"mapVersion", map.map_version}}));
  EXPECT_EQ(Action(state, "d1").status, ActionStatus::kFailed);
  ASSERT_THAT(Do(&service, Download("d2")), testing::IsOk());
  EXPECT_EQ(Errors(Fleet(&service)), std::vector<std::string>{kNotLocalized});
}

TEST_F(ServiceFleetTest, MapInUseIsNotDeletedAndAnUnknownOneIsNamed) {
  const FolderMap first = Added(first_);
  const FolderMap second = Added(second_);
  Service service = Opened();
  ASSERT_THAT(Do(&service, Enable("e", first)), testing::IsOk());
  EXPECT_EQ(Do(&service, DeleteMap{{"x1", "area", first.map_version}}).code(),
            StatusCode::kFailedPrecondition);
  EXPECT_THAT(Do(&service, DeleteMap{{"x2", "area", second.map_version}}), testing::IsOk());
  EXPECT_EQ(Do(&service, DeleteMap{{"x3", "area", second.map_version}}).code(),
            StatusCode::kNotFound);
  EXPECT_EQ(Do(&service, EnableMap{{"x4", "nowhere", "1-0-0"}}).code(), StatusCode::kNotFound);
  const auto errors = Errors(Fleet(&service));
  EXPECT_NE(std::find(errors.begin(), errors.end(), "UNKNOWN_MAP_ID WARNING"), errors.end());
  EXPECT_EQ(Fleet(&service).maps.size(), 1u);
}

TEST_F(ServiceFleetTest, ActionThatComesTwiceIsDoneOnceAndRemembered) {
  const FolderMap map = Added(first_);
  {
    Service service = Opened();
    ASSERT_THAT(Do(&service, Enable("e", map)), testing::IsOk());
    ASSERT_THAT(Do(&service, Enable("e", map)), testing::IsOk());
    EXPECT_EQ(Fleet(&service).actions.size(), 1u);
    service.SetDownloader(true);
    ASSERT_THAT(Do(&service, Download("d")), testing::IsOk());
    ASSERT_THAT(service.Shutdown(), testing::IsOk());
  }
  Service service = Opened();
  EXPECT_EQ(Action(Fleet(&service), "e").status, ActionStatus::kFinished);
  EXPECT_EQ(Action(Fleet(&service), "d").status, ActionStatus::kFailed);
  EXPECT_NE(Action(Fleet(&service), "d").result.find("restarted"), std::string::npos);
  ASSERT_THAT(Do(&service, ClearActions()), testing::IsOk());
  EXPECT_TRUE(Fleet(&service).actions.empty());
}

TEST_F(ServiceFleetTest, ActionsThatNobodyClearsAreBoundedAndSaidSo) {
  Service service = Opened();
  for (std::size_t i = 0; i <= ActionLog::kMaxActions; ++i) {
    EXPECT_FALSE(Do(&service, Download("d" + std::to_string(i))).ok());
  }
  const FleetState state = Fleet(&service);
  EXPECT_EQ(state.actions.size(), ActionLog::kMaxActions);
  EXPECT_EQ(state.actions.front().action_id, "d1");
  EXPECT_EQ(Errors(state).at(1), "INSTANT_ACTION_STATES_FULL URGENT");
}

TEST_F(ServiceFleetTest, PoseIsSetAtOnceOrOnceLandmarksAgree) {
  const FolderMap map = Added(first_);
  Service service = Opened();
  ASSERT_THAT(Do(&service, Enable("e", map)), testing::IsOk());
  PoseWithCovariance pose;
  pose.cov_T_map_vehicle = Eigen::Vector3d(0.25, 0.25, 0.04).asDiagonal();
  EXPECT_EQ(Do(&service, InitializePosition{"p0", "area", pose, false}).code(),
            StatusCode::kFailedPrecondition);
  ASSERT_THAT(Do(&service, Start()), testing::IsOk());
  EXPECT_EQ(Do(&service, InitializePosition{"p1", "hall", pose, false}).code(),
            StatusCode::kNotFound);
  EXPECT_THAT(Do(&service, InitializePosition{"p2", "area", pose, false}), testing::IsOk());
  EXPECT_EQ(Action(Fleet(&service), "p2").status, ActionStatus::kFinished);
  EXPECT_THAT(Do(&service, InitializePosition{"p3", "area", pose, true}), testing::IsOk());
  service.StepCallback(&events_);
  EXPECT_EQ(Action(Fleet(&service), "p3").status, ActionStatus::kRunning);
  const std::size_t third = items_.size() / 3;
  Feed(&service, 0, third);
  service.StepCallback(&events_);
  EXPECT_EQ(Action(Fleet(&service), "p3").status, ActionStatus::kFinished);
  // Where it is not.
  pose.T_map_vehicle = Se2(5.0, -4.0, 2.0);
  EXPECT_THAT(Do(&service, InitializePosition{"p4", "area", pose, true}), testing::IsOk());
  for (std::size_t i = third; i < items_.size(); ++i) {
    Feed(&service, i, i + 1);
    service.StepCallback(&events_);
  }
  EXPECT_EQ(Action(Fleet(&service), "p4").status, ActionStatus::kFailed);
}

TEST_F(ServiceFleetTest, PoseOnAnotherEnabledMapTakesTheVehicleThereWhenItStands) {
  const FolderMap area = Added(first_);
  const FolderMap hall = Added(hall_);
  Service service = Opened();
  ASSERT_THAT(Do(&service, Enable("e1", area)), testing::IsOk());
  ASSERT_THAT(Do(&service, Enable("e2", hall)), testing::IsOk());
  ASSERT_THAT(Do(&service, Start()), testing::IsOk());
  Feed(&service, 0, items_.size() / 2);
  PoseWithCovariance pose;
  pose.T_map_vehicle = Se2(1.0, 2.0, 0.5);
  pose.cov_T_map_vehicle = Eigen::Vector3d(0.25, 0.25, 0.04).asDiagonal();
  EXPECT_EQ(Do(&service, InitializePosition{"p1", "hall", pose, false}).code(),
            StatusCode::kFailedPrecondition);
  Stand(&service, StampOf(items_[items_.size() / 2 - 1]));
  EXPECT_THAT(Do(&service, InitializePosition{"p2", "hall", pose, false}), testing::IsOk());
  EXPECT_EQ(Fleet(&service).map_id, "hall");
  EXPECT_EQ(service.State().area, "hall");
  EXPECT_TRUE(service.State().running);
}

TEST_F(ServiceFleetTest, ShiftResumesOnItsMapAlthoughAnotherIsEnabledMeanwhile) {
  const FolderMap first = Added(first_);
  const FolderMap second = Added(second_);
  std::string uuid;
  {
    Service service = Opened();
    ASSERT_THAT(Do(&service, Enable("e", first)), testing::IsOk());
    ASSERT_THAT(Do(&service, Start()), testing::IsOk());
    Feed(&service, 0, items_.size() / 2);
    uuid = service.State().report_uuid;
  }
  ASSERT_THAT(folder_of_maps_->Enable("area", second.map_version), testing::IsOk());
  Service service = Opened();
  EXPECT_TRUE(service.State().resumed);
  EXPECT_EQ(service.State().report_uuid, uuid);
  EXPECT_EQ(service.State().version, VersionNumber(1));
  EXPECT_EQ(folder_of_maps_->Remove("area", first.map_version).code(),
            StatusCode::kFailedPrecondition);
  ASSERT_THAT(Do(&service, live::Stop()), testing::IsOk());
  ASSERT_THAT(Do(&service, Start()), testing::IsOk());
  EXPECT_EQ(service.State().version, VersionNumber(2));
}

TEST_F(ServiceFleetTest, OnlyTheOwnerChangesMapsIfThereIsOne) {
  has_map_owner_ = true;
  const FolderMap map = Added(first_);
  Service service = Opened();
  const Status refused = Do(&service, Enable("e", map));
  EXPECT_EQ(refused.code(), StatusCode::kFailedPrecondition);
  EXPECT_NE(Message(refused).find("map_source = server"), std::string::npos);
  EXPECT_EQ(Action(Fleet(&service), "e").status, ActionStatus::kFailed);
  EXPECT_EQ(Enabled(Fleet(&service), "area"), "");
  const Request owned{.id = 1, .command = Enable("e2", map), .from_map_owner = true};
  EXPECT_THAT(service.Handle(owned, &events_).status, testing::IsOk());
  EXPECT_EQ(Enabled(Fleet(&service), "area"), map.map_version);
}

TEST_F(ServiceFleetTest, WithoutAFolderTheMapIsListedAndNotChanged) {
  Service service = ServiceTest::Opened();
  const FleetState state = Fleet(&service);
  ASSERT_EQ(state.maps.size(), 1u);
  EXPECT_TRUE(state.maps[0].enabled);
  EXPECT_EQ(Do(&service, Download("d")).code(), StatusCode::kFailedPrecondition);
}

}  // namespace
}  // namespace shiftmap::live
