// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/check/log_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "tools/sim/open_world.h"

namespace shiftmap {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

const RunInfo kInfo = {"agv", "test", "3f0f0a53-7a52-4d4c-9df5-0f7a2c7c8b11", "hall"};

std::vector<RunEvent> GoodLog() {
  OpenWorldOptions options;
  options.seed = 4;
  options.runs = 1;
  options.duration_s = 60.0;
  options.size_m = 20.0;
  return MergeEvents(SimulateOpen(options).value().runs.front().run);
}

Findings Check(const std::vector<RunEvent>& events, const RunInfo& info = kInfo) {
  LogCheckOptions options;
  options.now = StampFromSeconds(1.9e9);
  LogCheck check(options);
  for (const RunEvent& event : events) check.Add(event);
  Findings findings = check.Finish(info);
  std::erase_if(findings, [](const Finding& f) { return f.code == "seen_once"; });
  return findings;
}

std::vector<std::string> Codes(const Findings& findings) {
  std::vector<std::string> codes;
  for (const Finding& finding : findings) {
    codes.push_back(std::string(SeverityName(finding.severity)) + " " + finding.code);
  }
  return codes;
}

void Shift(
    std::vector<RunEvent>* events,
    const std::function<Stamp(Stamp)>& move,
    const std::function<bool(const RunEvent&)>& which = [](const RunEvent&) { return true; }) {
  for (RunEvent& event : *events) {
    if (!which(event)) continue;
    std::visit([&](auto& item) { item.stamp = move(item.stamp); }, event);
  }
}

template <typename Item>
bool Is(const RunEvent& event) {
  return std::holds_alternative<Item>(event);
}

TEST(LogCheck, AGoodLogIsClean) { EXPECT_THAT(Codes(Check(GoodLog())), IsEmpty()); }

TEST(LogCheck, MissingNamesAreTold) {
  EXPECT_THAT(Codes(Check(GoodLog(), {})),
              ElementsAre("warning no_vehicle", "note no_area", "note no_run_uuid"));
}

TEST(LogCheck, ALogWithoutAKindOfItemsMakesNoMap) {
  auto events = GoodLog();
  std::erase_if(events, Is<Scan>);
  EXPECT_THAT(Codes(Check(events)), ElementsAre("error no_scans"));
  events = GoodLog();
  std::erase_if(events, Is<OdometrySample>);
  EXPECT_THAT(Codes(Check(events)), ElementsAre("error no_odometry"));
  EXPECT_THAT(Codes(Check({})), ElementsAre("error no_odometry"));
  events = GoodLog();
  for (RunEvent& event : events) {
    if (auto* scan = std::get_if<Scan>(&event)) scan->observations.clear();
  }
  EXPECT_THAT(Codes(Check(events)), ElementsAre("error no_observations"));
}

TEST(LogCheck, StampsInAnotherUnitAreTold) {
  for (const std::int64_t per_ns : {1'000'000'000, 1'000'000, 1000}) {
    auto events = GoodLog();
    Shift(&events,
          [&](Stamp stamp) { return StampFromNanoseconds(ToNanoseconds(stamp) / per_ns); });
    EXPECT_THAT(Codes(Check(events)), Contains("error stamp_unit")) << per_ns;
  }
}

TEST(LogCheck, ClocksThatWereWrongAreTold) {
  auto events = GoodLog();
  Shift(&events, [](Stamp stamp) { return stamp - FromSeconds(1.76e9); });
  EXPECT_THAT(Codes(Check(events)), ElementsAre("warning stamp_epoch"));
  events = GoodLog();
  Shift(&events, [](Stamp stamp) { return stamp + FromSeconds(3e8); });
  EXPECT_THAT(Codes(Check(events)), ElementsAre("error stamp_future"));
  events = GoodLog();
  Shift(
      &events, [](Stamp stamp) { return stamp + FromSeconds(100.0); }, Is<Scan>);
  EXPECT_THAT(Codes(Check(events)), Contains("error no_overlap"));
}

TEST(LogCheck, GapsAndJumpsArePlaced) {
  const Stamp begin = StampOf(GoodLog().front());
  const auto second_half = [&](const RunEvent& event) {
    return StampOf(event) >= begin + FromSeconds(30.0);
  };
  auto events = GoodLog();
  Shift(
      &events, [](Stamp stamp) { return stamp + FromSeconds(5.0); }, second_half);
  const Findings gaps = Check(events);
  EXPECT_THAT(Codes(gaps), ElementsAre("warning gap", "warning gap"));
  EXPECT_THAT(gaps[0].place, HasSubstr("29.950 s into the run"));
  EXPECT_THAT(gaps[0].message, HasSubstr("nothing for 5.0 s, usual are 0.050 s"));
  events = GoodLog();
  Shift(
      &events, [](Stamp stamp) { return stamp + FromSeconds(7200.0); }, second_half);
  EXPECT_THAT(Codes(Check(events)), ElementsAre("warning clock_jump", "warning clock_jump"));
  events = GoodLog();
  Shift(
      &events, [](Stamp stamp) { return stamp - FromSeconds(2.0); }, second_half);
  EXPECT_THAT(Codes(Check(events)), Contains("error out_of_order"));
}

TEST(LogCheck, ItemsBehindYoungerOnesAreTold) {
  auto events = GoodLog();
  std::stable_sort(events.begin(), events.end(), [](const RunEvent& a, const RunEvent& b) {
    const auto arrival = [](const RunEvent& event) {
      return StampOf(event) + FromSeconds(Is<Scan>(event) ? 0.3 : 0.0);
    };
    return arrival(a) < arrival(b);
  });
  const Findings findings = Check(events);
  EXPECT_THAT(Codes(findings), Contains("warning late_items"));
  EXPECT_THAT(Codes(findings), Not(Contains("error out_of_order")));
}

TEST(LogCheck, OdometryThatStandsOrSticksIsTold) {
  auto events = GoodLog();
  for (RunEvent& event : events) {
    if (auto* sample = std::get_if<OdometrySample>(&event)) sample->v_mps = sample->omega_radps = 0;
  }
  EXPECT_THAT(Codes(Check(events)), Contains("warning standing_still"));
  for (RunEvent& event : events) {
    if (auto* sample = std::get_if<OdometrySample>(&event)) sample->v_mps = 1.0;
  }
  Shift(&events, [first = StampOf(events[0])](Stamp stamp) { return first + 2 * (stamp - first); });
  EXPECT_THAT(Codes(Check(events)), Contains("warning odometry_constant"));
}

TEST(LogCheck, UnitsShowInTheNumbers) {
  const auto with_odometry = [](double v, double omega) {
    auto events = GoodLog();
    for (RunEvent& event : events) {
      if (auto* sample = std::get_if<OdometrySample>(&event)) {
        sample->v_mps *= v;
        sample->omega_radps *= omega;
      }
    }
    return Codes(Check(events));
  };
  const auto with_z = [](double range, double bearing) {
    auto events = GoodLog();
    for (RunEvent& event : events) {
      auto* scan = std::get_if<Scan>(&event);
      if (scan == nullptr) continue;
      for (Observation& observation : scan->observations) {
        observation.z.x() *= range;
        observation.z.y() *= bearing;
      }
    }
    return Codes(Check(events));
  };
  EXPECT_THAT(with_odometry(1000.0, 1.0), Contains("warning speed_unit"));
  EXPECT_THAT(with_odometry(1000.0, 1.0), Contains("warning odometry_limit"));
  EXPECT_THAT(with_odometry(1.0, 57.3), Contains("warning yaw_rate_unit"));
  EXPECT_THAT(with_z(1000.0, 1.0), Contains("warning range_millimetres"));
  EXPECT_THAT(with_z(1.0, 57.3), Contains("warning bearing_degrees"));
  EXPECT_THAT(with_z(1.0, -1.0), ElementsAre("warning bearing_sign"));
}

TEST(LogCheck, OneSignatureAtTwoPlacesOfAScanIsTold) {
  auto events = GoodLog();
  for (RunEvent& event : events) {
    auto* scan = std::get_if<Scan>(&event);
    if (scan == nullptr || scan->observations.empty()) continue;
    Observation other = scan->observations.front();
    other.z.x() += 0.3;  // Noise,
    scan->observations.push_back(other);
    EXPECT_THAT(Codes(Check(events)), IsEmpty());
    scan->observations.back().z.x() += 0.3;  // and no noise.
    break;
  }
  const Findings findings = Check(events);
  EXPECT_THAT(Codes(findings), ElementsAre("warning signature_twice"));
  EXPECT_THAT(findings[0].message, HasSubstr("at two places in one scan; such sightings: 1"));
}

TEST(LogCheck, SignaturesThatAreCountersAreTold) {
  auto events = GoodLog();
  int number = 0;
  for (RunEvent& event : events) {
    auto* scan = std::get_if<Scan>(&event);
    if (scan == nullptr) continue;
    for (Observation& o : scan->observations) o.signature = Signature(std::to_string(++number));
  }
  LogCheckOptions options;
  options.now = StampFromSeconds(1.9e9);
  LogCheck check(options);
  for (const RunEvent& event : events) check.Add(event);
  EXPECT_EQ(check.scans().seen_once(), number);
  EXPECT_THAT(Codes(check.Finish(kInfo)), Contains("warning seen_once"));
}

}  // namespace
}  // namespace shiftmap
