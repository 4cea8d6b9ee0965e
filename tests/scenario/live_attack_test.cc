// SPDX-License-Identifier: Apache-2.0
//
// The localizer as a service under attack: clients that take its places and its time, messages that
// are valid and extreme, processes that die.
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <random>

#include "localizer/live/codec/live_codec.h"
#include "localizer/live/framing.h"
#include "localizer/live/unix_socket.h"
#include "tests/scenario/live_fixture.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

class LiveAttackTest : public LiveTest {
 protected:
  OwnedFd Raw(const std::string& bytes = "") const {
    StatusOr<OwnedFd> fd = live::ConnectTo(socket_);
    EXPECT_THAT(fd, IsOk());
    if (!bytes.empty()) send(fd->get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
    return *std::move(fd);
  }

  // An operator's command, which must not wait for what others do.
  Json Operate(const std::string& verb) const {
    const auto begin = Clock::now();
    Json state = RunForJson("shiftmap-localizer", {"ctl", "--socket", socket_, verb});
    EXPECT_LT(Clock::now() - begin, std::chrono::seconds(2)) << verb;
    return state;
  }

  static live::Command CommandOf(const RunEvent& item) {
    return std::visit([](const auto& value) { return live::Command(value); }, item);
  }

  // Says one thing without waiting, over and over, for as long as `stop` is false.
  std::thread Flood(const live::Request& request, const std::atomic<bool>* stop) const {
    std::string bytes;
    const std::string frame = live::Framed(live::EncodeRequest(request));
    while (bytes.size() < 8192) bytes += frame;
    return std::thread([this, bytes, stop] {
      const OwnedFd fd = Raw();
      std::size_t at = 0;
      while (!*stop) {
        const ssize_t count =
            send(fd.get(), bytes.data() + at, bytes.size() - at, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (count > 0) at = (at + static_cast<std::size_t>(count)) % bytes.size();
        if (count <= 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    });
  }
};

TEST_F(LiveAttackTest, ClientsThatSayNothingLockNobodyOut) {
  const auto service = Served({"--start"});
  live::Client driver = Connected();
  EXPECT_THAT(driver.Call(CommandOf(items_->at(0))), IsOk());
  live::Client listener = Connected();
  Call(&listener, live::Subscribe{.poses = true, .states = true, .decisions = true});

  std::vector<OwnedFd> idle;
  const std::string half = live::Framed(std::string(200'000, 'x')).substr(0, 100'000);
  for (int i = 0; i < 64; ++i) idle.push_back(Raw(i % 2 == 0 ? "" : half));
  EXPECT_EQ(Operate("state")["running"], true);

  std::atomic<int> connects = 0;
  std::thread flood([&] {
    std::vector<OwnedFd> open(200);
    for (; connects < 1000; ++connects) open[static_cast<std::size_t>(connects) % 200] = Raw();
  });
  while (connects < 1000) EXPECT_EQ(Operate("state")["running"], true);
  flood.join();
  EXPECT_GE(Operate("state")["dropped"]["client"], 500);

  // Neither the driver nor the listener was closed.
  const live::ServiceState state = Feed(&driver, 1, 1000);
  EXPECT_GT(state.scans, 0);
  EXPECT_THAT(listener.Receive(), IsOk());
  EXPECT_EQ(Operate("stop")["running"], false);
}

TEST_F(LiveAttackTest, ThirtyTwoDriversLeaveRoomForAnOperator) {
  const auto service = Served({"--start"});
  std::vector<live::Client> drivers;
  for (int i = 0; i < 32; ++i) {
    drivers.push_back(Connected());
    Call(&drivers.back(), live::Subscribe{.poses = false, .states = true, .decisions = false});
  }
  std::vector<OwnedFd> idle;
  for (int i = 0; i < 32; ++i) idle.push_back(Raw());
  EXPECT_EQ(Operate("state")["running"], true);
  EXPECT_EQ(Operate("stop")["running"], false);
  for (live::Client& driver : drivers) EXPECT_THAT(driver.Call(live::GetState()), IsOk());
}

TEST_F(LiveAttackTest, FloodsOfQuestionsDelayNobodyForLong) {
  const auto service = Served({"--start"});
  live::Client driver = Connected();
  Feed(&driver, 0, items_->size() / 2);
  std::atomic<bool> stop = false;
  std::vector<std::thread> floods;
  for (const std::uint64_t id : {0u, 0u, 0u, 1u}) {
    floods.push_back(Flood({.id = id, .command = live::GetState{.hypotheses = true}}, &stop));
  }
  auto longest = Clock::duration::zero();
  for (std::size_t i = items_->size() / 2; i < items_->size() / 2 + 100; ++i) {
    const auto begin = Clock::now();
    EXPECT_THAT(driver.Call(CommandOf(items_->at(i))), IsOk());
    longest = std::max(longest, Clock::now() - begin);
  }
  EXPECT_LT(longest, std::chrono::milliseconds(500));
  EXPECT_EQ(Operate("state")["running"], true);
  EXPECT_EQ(Operate("stop")["running"], false);
  stop = true;
  for (std::thread& flood : floods) flood.join();
}

// Each is kept for no longer than the landmark could be a real one.
TEST_F(LiveAttackTest, ManySignaturesSeenOnceCostLittleMemory) {
  constexpr std::size_t kSignatures = 400'000;
  constexpr std::size_t kPerScan = 200;
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  constexpr double kMoreMib = 4096.0;  // Sanitizers keep memory of their own.
#else
  constexpr double kMoreMib = 64.0;
#endif
  double normal_mib = 0.0;
  for (const std::size_t signatures : {std::size_t{0}, kSignatures}) {
    const auto service = Served({"--start"});
    live::Client client = Connected();
    Feed(&client, 0, items_->size() / 2);
    Scan scan;
    scan.stamp = StampOf(items_->at(items_->size() / 2));
    for (std::size_t i = 0; i < signatures; i += kPerScan) {
      scan.observations.clear();
      scan.stamp += std::chrono::milliseconds(1);
      for (std::size_t j = i; j < i + kPerScan; ++j) {
        Observation& observation = scan.observations.emplace_back();
        observation.signature = Signature(fmt::format("a signature seen once, number {:09}", j));
        observation.z = {5.0, 0.001 * static_cast<double>(j - i)};
      }
      ASSERT_THAT(client.Send({.id = 0, .command = scan}), IsOk()) << service->Errors();
    }
    const live::ServiceState state = Call(&client, live::GetState());
    EXPECT_GE(state.scans, static_cast<std::int64_t>(signatures / kPerScan));
    EXPECT_EQ(Operate("stop")["running"], false);
    EXPECT_EQ(service->End(SIGTERM), kDone);
    RecordProperty(signatures == 0 ? "normal_mib" : "flooded_mib",
                   fmt::format("{:.1f}", service->PeakMib()));
    if (signatures == 0) normal_mib = service->PeakMib();
    EXPECT_LT(service->PeakMib(), normal_mib + kMoreMib);
  }
}

TEST_F(LiveAttackTest, AJournalThatTwiceEndedTheProcessCostsThatShiftOnly) {
  std::string uuid;
  {
    const auto service = Served({"--start"});
    live::Client client = Connected();
    uuid = Feed(&client, 0, 200).report_uuid;
    service->End(SIGKILL);
  }
  WriteFile(socket_ + ".state/shift.resuming", "0 2\n");
  const auto service = Served({"--start"});
  EXPECT_NE(service->Errors().find("2 times at one place"), std::string::npos) << service->Errors();
  live::Client client = Connected();
  const live::ServiceState state = Feed(&client, 0, items_->size());
  EXPECT_TRUE(state.running);
  EXPECT_NE(state.report_uuid, uuid);
  EXPECT_FALSE(Said(Call(&client, live::Stop()).report_path).empty());
}

// Draws what is valid and makes no sense.
class ExtremeMessages {
 public:
  ExtremeMessages(const std::vector<RunEvent>& items, std::uint64_t seed)
      : items_(items), random_(seed) {
    for (const RunEvent& item : items) {
      const auto* scan = std::get_if<Scan>(&item);
      if (scan == nullptr) continue;
      for (const Observation& seen : scan->observations) known_.push_back(seen.signature);
    }
  }

  live::Command Draw(std::size_t item) {
    const Stamp stamp = StampOf(items_[item]) + Jitter();
    switch (Below(10)) {
      case 0:
        return InitializePose();
      case 1:
      case 2:
        return OdometrySample{stamp, Signed(-9.0, 9.0), Signed(-9.0, 9.0)};
      case 3:
      case 4:
      case 5: {
        Scan scan{stamp, {}};
        for (std::size_t i = Below(6); i > 0; --i) scan.observations.push_back(Seen());
        return scan;
      }
      default:
        return std::visit([](const auto& value) { return live::Command(value); }, items_[item]);
    }
  }

 private:
  std::size_t Below(std::size_t count) { return random_() % count; }

  // A number whose decimal exponent is within these bounds.
  double Positive(double low, double high) {
    return std::min(std::pow(10.0, std::uniform_real_distribution(low, high)(random_)), 1e9);
  }
  double Signed(double low, double high) {
    return Below(2) == 0 ? Positive(low, high) : -Positive(low, high);
  }

  Duration Jitter() {
    const std::size_t kind = Below(20);
    if (kind == 0) return -std::chrono::hours(1);
    if (kind == 1) return std::chrono::milliseconds(900);
    return kind < 5 ? -std::chrono::milliseconds(Below(400)) : Duration::zero();
  }

  Observation Seen() {
    Observation seen;
    seen.signature = Below(3) == 0 ? Signature("stray " + std::to_string(Below(1000)))
                                   : known_[Below(known_.size())];
    seen.kind = Below(2) == 0 ? Observation::Kind::kRangeBearing : Observation::Kind::kCartesian;
    const bool polar = seen.kind == Observation::Kind::kRangeBearing;
    seen.z = {polar ? Positive(-9.0, 9.0) : Signed(-9.0, 9.0), Signed(-9.0, 9.0)};
    if (Below(2) == 0) {
      seen.cov_z = Eigen::Vector2d(Positive(-9.0, 9.0), Positive(-9.0, 9.0)).asDiagonal();
    }
    return seen;
  }

  live::InitializePose InitializePose() {
    live::InitializePose start;
    start.pose.T_map_vehicle = Se2(Signed(-9.0, 9.0), Signed(-9.0, 9.0), Signed(-3.0, 3.0));
    start.pose.cov_T_map_vehicle =
        Eigen::Vector3d(Positive(-9.0, 9.0), Positive(-9.0, 9.0), Positive(-9.0, 9.0)).asDiagonal();
    return start;
  }

  const std::vector<RunEvent>& items_;
  std::vector<Signature> known_;
  std::mt19937_64 random_;
};

TEST_F(LiveAttackTest, ExtremeMessagesAndCrashesNeitherEndTheServiceNorItsShifts) {
  constexpr std::size_t kMessages = 10'000;
  constexpr std::size_t kLives = 10;
  max_delay_s_ = "0.2";
  const std::uint64_t seed = TestSeed(17);
  ExtremeMessages messages(*items_, seed);
  auto service = Served({"--start"});
  for (std::size_t sent = 0; sent < kMessages;) {
    live::Client client = Connected();
    for (std::size_t i = 0; i < kMessages / kLives; ++i, ++sent) {
      const live::Command command = messages.Draw(sent * items_->size() / kMessages);
      ASSERT_THAT(client.Send({.id = 0, .command = command}), IsOk())
          << "message " << sent << " of seed " << seed << ": " << service->Errors();
    }
    ASSERT_THAT(client.Call(live::GetState()), IsOk()) << "seed " << seed << service->Errors();
    EXPECT_EQ(service->End(SIGKILL), 128 + SIGKILL);
    service = Served({"--start"});
    live::Client next = Connected();
    ASSERT_TRUE(Call(&next, live::GetState()).resumed) << "seed " << seed << service->Errors();
  }
  const std::string store = folder_.File("maps.db");
  std::filesystem::copy_file(world_->File("maps.db"), store);
  live::Client client = Connected();
  const std::string extreme = Call(&client, live::Stop{.save_pose = true}).report_path;
  RunForJson("shiftmap-localizer", {"return", "--store", store, extreme});

  Call(&client, live::Start());
  const live::ServiceState state = Feed(&client, 0, items_->size());
  EXPECT_TRUE(state.localizer_state == LocalizerState::kTracking ||
              state.localizer_state == LocalizerState::kModeChanged)
      << ToString(state.localizer_state);
  const std::string normal = Call(&client, live::Stop()).report_path;
  EXPECT_FALSE(Said(normal).empty());
  RunForJson("shiftmap-localizer", {"return", "--store", store, normal});
  EXPECT_EQ(service->End(SIGTERM), kDone);
}

}  // namespace
}  // namespace shiftmap::testing
