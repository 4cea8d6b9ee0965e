// SPDX-License-Identifier: Apache-2.0
//
// Shifts that end although something does not fit: the report, the disk, the clock.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <filesystem>

#include "tests/unit/localizer/live/service_fixture.h"

namespace shiftmap::live {
namespace {

using testing::IsOk;
using testing::StatusIs;

// A disk that takes no byte as long as this lives.
class FullDisk {
 public:
  FullDisk() {
    std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit none = before_;
    none.rlim_cur = 0;
    setrlimit(RLIMIT_FSIZE, &none);
  }
  ~FullDisk() { setrlimit(RLIMIT_FSIZE, &before_); }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  rlimit before_{};
};

class ServiceEndTest : public ServiceTest {
 protected:
  ServiceEndTest() {
    for (RunEvent& item : items_) Move(kBegin, &item);
  }

  static void Move(Duration by, RunEvent* item) {
    std::visit([&](auto& value) { value.stamp += by; }, *item);
  }

  Service OpenedWithClocks() {
    ServiceOptions options = Options();
    options.clock = [this] { return host_now_; };
    options.steady_clock = [this] { return steady_now_; };
    StatusOr<Service> service = Service::Open(options);
    EXPECT_THAT(service, IsOk());
    return *std::move(service);
  }

  // Feeds items at their own pace with the vehicle's clock and the host's set by so much; returns
  // how many were refused.
  int FeedAtPace(
      Service* service, std::size_t begin, std::size_t end, Duration vehicle_by, Duration host_by) {
    int refused = 0;
    for (std::size_t i = begin; i < end; ++i) {
      RunEvent item = items_[i];
      host_now_ = StampOf(item) + host_by;
      steady_now_ = TimeLineWatch::Clock::time_point() + (StampOf(item) - Stamp());
      Move(vehicle_by, &item);
      const auto command = std::visit([](const auto& value) { return Command(value); }, item);
      if (!service->Handle({.id = 1, .command = command}, &events_).status.ok()) ++refused;
    }
    return refused;
  }

  // Items within the first second and a sample's time after one.
  int WithinASecond(std::size_t begin) const {
    int count = 0;
    while (StampOf(items_[begin + static_cast<std::size_t>(count)]) <
           StampOf(items_[begin]) + std::chrono::seconds(1)) {
      ++count;
    }
    return count;
  }

  // The shift's last second of odometry is of a vehicle that stands.
  void Park() {
    OdometrySample standing;
    standing.stamp = StampOf(items_.back());
    for (int i = 0; i < 20; ++i, standing.stamp += std::chrono::milliseconds(50)) {
      items_.emplace_back(standing);
    }
  }

  // Scans in which nothing is seen go on after the last odometry.
  void SilenceOdometry() {
    Scan scan;
    scan.stamp = StampOf(items_.back());
    for (int i = 0; i < 20; ++i) {
      scan.stamp += std::chrono::milliseconds(250);
      items_.emplace_back(scan);
    }
  }

  bool Told(LocalizerState state) const {
    return std::any_of(events_.begin(), events_.end(), [&](const Event& event) {
      const auto* told = std::get_if<StateEvent>(&event);
      return told != nullptr && told->state == state;
    });
  }

  static constexpr Duration kBegin = std::chrono::hours(10);
  static constexpr Duration kHour = std::chrono::hours(1);
  static constexpr Duration kNone = Duration::zero();
  Stamp host_now_;
  TimeLineWatch::Clock::time_point steady_now_;
};

TEST_F(ServiceEndTest, AReportThatNoReaderAcceptsEndsTheShiftAndKeepsTheJournal) {
  ServiceOptions options = Options();
  options.clock = [] { return Stamp() + 2 * kBegin; };
  options.software.clear();
  StatusOr<Service> service = Service::Open(options);
  ASSERT_THAT(service, IsOk());
  ASSERT_THAT(Do(&*service, Start()), IsOk());
  Feed(&*service, 0, 50);
  EXPECT_THAT(service->Shutdown(), IsOk());
  EXPECT_FALSE(service->State().running);
  EXPECT_EQ(service->State().report_path, "");
  ASSERT_FALSE(warnings_.empty());
  EXPECT_NE(warnings_[0].find("software"), std::string::npos) << warnings_[0];
  EXPECT_NE(warnings_[0].find("interrupted-"), std::string::npos) << warnings_[0];
  EXPECT_FALSE(std::filesystem::exists(Journal()));
  EXPECT_THAT(Do(&*service, Start()), IsOk());
}

TEST_F(ServiceEndTest, AFullDiskIsWaitedFor) {
  Service service = OpenedWithClocks();
  ASSERT_THAT(Do(&service, Start()), IsOk());
  EXPECT_EQ(FeedAtPace(&service, 0, 50, kNone, kNone), 0);
  {
    const FullDisk full;
    EXPECT_THAT(Do(&service, live::Stop()), StatusIs(StatusCode::kUnavailable, "cannot write"));
    EXPECT_TRUE(service.State().running);
  }
  Stop(&service);
}

TEST_F(ServiceEndTest, AFullDiskIsNamedOnceAShift) {
  Service service = OpenedWithClocks();
  for (std::size_t shift = 1; shift <= 2; ++shift) {
    ASSERT_THAT(Do(&service, Start()), IsOk());
    for (std::size_t begin = 0; begin < 50; begin += 10) {
      const FullDisk full;
      EXPECT_EQ(FeedAtPace(&service, begin, begin + 10, kNone, kNone), 0);
      service.WriteJournal();
    }
    EXPECT_EQ(warnings_.size(), shift);
    EXPECT_NE(warnings_.back().find("shift.journal': cannot write"), std::string::npos);
    Stop(&service);
  }
}

TEST_F(ServiceEndTest, APoseThatCannotBeSavedDoesNotKeepTheShift) {
  Service service = OpenedWithClocks();
  ASSERT_THAT(Do(&service, Start()), IsOk());
  Park();
  EXPECT_EQ(FeedAtPace(&service, 0, items_.size(), kNone, kNone), 0);
  std::filesystem::create_directory(folder_.File("state") + "/pose");
  EXPECT_THAT(service.Shutdown(), IsOk());
  EXPECT_FALSE(service.State().running);
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_NE(warnings_[0].find("was not saved"), std::string::npos) << warnings_[0];
}

TEST_F(ServiceEndTest, ThePoseOfAVehicleThatDrivesIsNotSaved) {
  for (const bool parked : {false, true}) {
    Service service = OpenedWithClocks();
    ASSERT_THAT(Do(&service, Start()), IsOk());
    if (parked) Park();
    EXPECT_EQ(FeedAtPace(&service, 0, items_.size(), kNone, kNone), 0);
    EXPECT_THAT(service.Shutdown(), IsOk());
    EXPECT_EQ(std::filesystem::exists(folder_.File("state") + "/pose"), parked);
  }
}

// Whoever stood when odometry fell silent may have driven on.
TEST_F(ServiceEndTest, ThePoseOfAVehicleWhoseOdometryIsSilentIsNotSaved) {
  Service service = OpenedWithClocks();
  ASSERT_THAT(Do(&service, Start()), IsOk());
  Park();
  SilenceOdometry();
  EXPECT_EQ(FeedAtPace(&service, 0, items_.size(), kNone, kNone), 0);
  EXPECT_THAT(service.Shutdown(), IsOk());
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_NE(warnings_[0].find("stands"), std::string::npos) << warnings_[0];
  EXPECT_FALSE(std::filesystem::exists(folder_.File("state") + "/pose"));
}

// Else it begins in 1970, as if the vehicle's clock was not set.
TEST_F(ServiceEndTest, AShiftWithoutItemsIsReportedAtTheTimeOfItsEnd) {
  host_now_ = StampOf(items_.front());
  Service service = OpenedWithClocks();
  ASSERT_THAT(Do(&service, Start()), IsOk());
  ASSERT_THAT(Do(&service, live::Stop()), IsOk());
  const StatusOr<ShiftReport> report = ReadShiftReport(service.State().report_path);
  ASSERT_THAT(report, IsOk());
  EXPECT_EQ(report->begin, host_now_);
  EXPECT_EQ(report->end, host_now_);
}

TEST_F(ServiceEndTest, NamesThatNoReportCarriesAreRefused) {
  ServiceOptions options = Options();
  for (const std::size_t length : {0u, 1025u}) {
    options.vehicle = std::string(length, 'x');
    EXPECT_THAT(Service::Open(options), StatusIs(StatusCode::kInvalidArgument, "vehicle"));
  }
  options = Options();
  options.state_dir = folder_.File(std::string(300, 'x'));
  EXPECT_THAT(Service::Open(options), StatusIs(StatusCode::kInvalidArgument, "state folder"));
  options.state_dir = std::string(5000, '/');
  EXPECT_THAT(Service::Open(options), StatusIs(StatusCode::kInvalidArgument, "state folder"));
  options.state_dir = folder_.File("no/folder");
  EXPECT_THAT(Service::Open(options), StatusIs(StatusCode::kNotFound, "state folder"));
  testing::WriteFile(folder_.File("file"), "");
  options.state_dir = folder_.File("file");
  EXPECT_THAT(Service::Open(options), StatusIs(StatusCode::kInvalidArgument, "state folder"));
}

TEST_F(ServiceEndTest, AClockSetBackEndsTheShiftAndAnotherGoesOn) {
  const std::size_t half = items_.size() / 2;
  Service service = OpenedWithClocks();
  ASSERT_THAT(Do(&service, Start()), IsOk());
  EXPECT_EQ(FeedAtPace(&service, 0, half, kNone, kNone), 0);
  const ServiceState before = service.State();
  ASSERT_EQ(before.localizer_state, LocalizerState::kTracking);
  events_.clear();
  EXPECT_EQ(FeedAtPace(&service, half, items_.size(), -kHour, -kHour), WithinASecond(half));
  EXPECT_TRUE(Told(LocalizerState::kLost));
  EXPECT_TRUE(Told(LocalizerState::kInitializing));
  const ServiceState after = service.State();
  EXPECT_TRUE(after.running);
  EXPECT_EQ(after.time_line, TimeLine::kAgrees);
  EXPECT_EQ(after.clock_jumps, 1);
  EXPECT_NE(after.report_uuid, before.report_uuid);
  EXPECT_LT(after.stamp, before.stamp);
  EXPECT_EQ(after.localizer_state, LocalizerState::kTracking);
  ASSERT_TRUE(after.pose);

  // The vehicle is where it is without the jump.
  const auto first = ReadShiftReport(after.report_path);
  ASSERT_THAT(first, IsOk());
  EXPECT_EQ(first->uuid, before.report_uuid);
  EXPECT_FALSE(first->evidence.empty());
  EXPECT_FALSE(DecodeShiftReport(Stop(&service))->evidence.empty());
  ASSERT_THAT(Do(&service, Start()), IsOk());
  EXPECT_EQ(FeedAtPace(&service, 0, items_.size(), kNone, kNone), 0);
  EXPECT_LT(
      (service.State().pose->T_map_vehicle.translation() - after.pose->T_map_vehicle.translation())
          .norm(),
      0.3);
}

TEST_F(ServiceEndTest, AClockSetForwardAndBackCostsNoShift) {
  const std::size_t third = items_.size() / 3;
  Service service = OpenedWithClocks();
  ASSERT_THAT(Do(&service, Start()), IsOk());
  EXPECT_EQ(FeedAtPace(&service, 0, third, kNone, kNone), 0);
  EXPECT_EQ(FeedAtPace(&service, third, 2 * third, kHour, kHour), 0);
  EXPECT_EQ(FeedAtPace(&service, 2 * third, items_.size(), kNone, kNone), WithinASecond(2 * third));
  EXPECT_EQ(service.State().clock_jumps, 1);
  EXPECT_THAT(ReadShiftReport(service.State().report_path), IsOk());
  Stop(&service);
}

TEST_F(ServiceEndTest, WhileTheDiskIsFullAClockSetBackIsTold) {
  const std::size_t half = items_.size() / 2;
  const std::size_t quarter = half + items_.size() / 4;
  Service service = OpenedWithClocks();
  ASSERT_THAT(Do(&service, Start()), IsOk());
  FeedAtPace(&service, 0, half, kNone, kNone);
  const std::string uuid = service.State().report_uuid;
  {
    const FullDisk full;
    FeedAtPace(&service, half, quarter, -kHour, -kHour);
  }
  const ServiceState state = service.State();
  EXPECT_EQ(state.report_uuid, uuid);
  EXPECT_EQ(state.time_line, TimeLine::kLate);
  EXPECT_EQ(state.localizer_state, LocalizerState::kLost);
  EXPECT_FALSE(state.pose);
  FeedAtPace(&service, quarter, items_.size(), -kHour, -kHour);
  EXPECT_NE(service.State().report_uuid, uuid);
  EXPECT_EQ(service.State().time_line, TimeLine::kAgrees);
}

TEST_F(ServiceEndTest, AHostClockSetBackIsToldUntilItAgreesAgain) {
  const std::size_t third = items_.size() / 3;
  Service service = OpenedWithClocks();
  ASSERT_THAT(Do(&service, Start()), IsOk());
  FeedAtPace(&service, 0, third, kNone, kNone);
  const std::string uuid = service.State().report_uuid;
  EXPECT_EQ(FeedAtPace(&service, third, 2 * third, kNone, -kHour), static_cast<int>(third));
  EXPECT_TRUE(Told(LocalizerState::kLost));
  ServiceState state = service.State();
  EXPECT_EQ(state.time_line, TimeLine::kFuture);
  EXPECT_EQ(state.localizer_state, LocalizerState::kLost);
  EXPECT_FALSE(state.pose);
  EXPECT_EQ(FeedAtPace(&service, 2 * third, items_.size(), kNone, kNone), 0);
  state = service.State();
  EXPECT_EQ(state.time_line, TimeLine::kAgrees);
  EXPECT_EQ(state.report_uuid, uuid);
  EXPECT_EQ(state.clock_jumps, 0);
  EXPECT_TRUE(state.pose);
}

TEST_F(ServiceEndTest, OneBadStampChangesNothing) {
  const std::size_t half = items_.size() / 2;
  for (const Duration by : {-kHour, kHour}) {
    Service service = OpenedWithClocks();
    ASSERT_THAT(Do(&service, Start()), IsOk());
    EXPECT_EQ(FeedAtPace(&service, 0, half, kNone, kNone), 0);
    const std::string uuid = service.State().report_uuid;
    EXPECT_EQ(FeedAtPace(&service, half, half + 1, by, kNone), 1);
    EXPECT_EQ(service.State().time_line, TimeLine::kAgrees);
    EXPECT_EQ(FeedAtPace(&service, half + 30, items_.size(), kNone, kNone), 0);
    EXPECT_EQ(service.State().report_uuid, uuid);
    EXPECT_EQ(service.State().clock_jumps, 0);
    Stop(&service);
  }
  EXPECT_TRUE(warnings_.empty());
}

}  // namespace
}  // namespace shiftmap::live
