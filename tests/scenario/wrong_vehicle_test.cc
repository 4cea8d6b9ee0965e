// SPDX-License-Identifier: Apache-2.0
//
// One vehicle of a fleet reports what is not so, night after night. Beside the store of the fleet
// is one to which it never reported: the oracle.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "mapstore/codec/run_log.h"
#include "mapstore/codec/shift_report.h"
#include "tests/scenario/command.h"
#include "tests/scenario/world.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {
namespace {

constexpr int kMapped = 3;  // The map is built from runs 0 to 2.
constexpr int kShifts = 9;

struct Fault {
  std::string name;
  int seed;
};

class WrongVehicleTest : public ::testing::TestWithParam<Fault> {
 protected:
  WrongVehicleTest()
      : world_({"--seed",
                std::to_string(GetParam().seed),
                "--shifts",
                std::to_string(kShifts),
                "--duration-s",
                "120",
                "--groups",
                "14",
                "--size-m",
                "22",
                "--shift-interval-s",
                "28800",
                "--mode-change-probability",
                "0.1"}) {
    for (const char* const store : {"fleet.db", "oracle.db"}) {
      RunForJson("shiftmap-mapper", world_.BuildOf(store, {0, 1, 2}));
    }
  }

  // The report of a log, localized with what the fleet knows when it begins.
  ShiftReport Localize(const std::string& log, const std::string& store) const {
    const std::string path = world_.File("shift.report");
    RunCommand("shiftmap-localizer",
               {"run", "--store", world_.File(store), "--area", "floor", "--report", path, log});
    const auto report = ReadShiftReport(path);
    EXPECT_THAT(report, IsOk());
    return *report;
  }

  void Return(const std::vector<ShiftReport>& reports, const std::string& store) const {
    Arguments words = {"return", "--store", world_.File(store)};
    for (const ShiftReport& report : reports) {
      words.push_back(world_.File(report.uuid + ".report"));
      ASSERT_THAT(WriteShiftReport(report, words.back()), IsOk());
    }
    RunForJson("shiftmap-localizer", words);
  }

  // What the wrong vehicle hands in about the place and the hours of a shift, just before it.
  std::vector<ShiftReport> WrongReports(int run) const {
    shiftmap::Run log = ReadRunLog(world_.Log(run))->run;
    log.info.vehicle = "wrong";
    for (OdometrySample& sample : log.odometry) {
      sample.stamp -= std::chrono::hours(1);
      if (GetParam().name == "reversed") sample.v_mps = -sample.v_mps;
      if (GetParam().name == "reversed") sample.omega_radps = -sample.omega_radps;
      if (GetParam().name == "frozen") sample.v_mps = sample.omega_radps = 0.0;
    }
    for (Scan& scan : log.scans) scan.stamp -= std::chrono::hours(1);
    const std::string path = world_.File("wrong.mcap");
    EXPECT_THAT(WriteRunLog(log, path), IsOk());
    ShiftReport report = Localize(path, "fleet.db");
    report.run_hash.clear();
    if (GetParam().name != "lies" && GetParam().name != "flood") return {report};
    for (VisitEvidence& visit : report.evidence) {
      // Every landmark is where it is least likely, or away, and nothing is surer.
      const auto least = std::min_element(
          visit.modes.begin(), visit.modes.end(), [](const auto& a, const auto& b) {
            return a.log_likelihood < b.log_likelihood;
          });
      for (auto& mode : visit.modes) mode.log_likelihood = -50.0;
      least->log_likelihood = 0.0;
    }
    if (GetParam().name == "lies") return {report};
    std::vector<ShiftReport> reports;
    for (const VisitEvidence& visit : report.evidence) {
      for (int i = 0; i < 10; ++i) {
        ShiftReport small = report;
        small.uuid = RandomUuid();
        small.evidence = {visit};
        small.evidence[0].begin += std::chrono::milliseconds(i);
        small.evidence[0].end = std::max(small.evidence[0].begin, small.evidence[0].end);
        small.end = std::max(small.end, small.evidence[0].end);
        small.decisions.clear();
        small.sightings.clear();
        reports.push_back(small);
      }
    }
    return reports;
  }

  // Probabilities by signature and mode at a time.
  std::map<std::string, std::map<int, double>> Show(const std::string& store, Stamp at) const {
    const Json shown = RunForJson("shiftmap-inspect",
                                  {"show",
                                   "--store",
                                   world_.File(store),
                                   "--area",
                                   "floor",
                                   "--at",
                                   fmt::format("{:.3f}", ToSecondsSinceEpoch(at))});
    std::map<std::string, std::map<int, double>> probabilities;
    for (const Json& group : shown["groups"]) {
      for (const Json& mode : group["modes"]) {
        probabilities[group["signature"]][mode["mode"]] = mode["probability"];
      }
    }
    return probabilities;
  }

  World world_;
};

TEST_P(WrongVehicleTest, OneHonestShiftMendsWhatItReports) {
  int judged = 0;
  int turned = 0;  // By the wrong vehicle, before the honest shift.
  for (int run = kMapped; run < kShifts; ++run) {
    Return(WrongReports(run), "fleet.db");
    const ShiftReport honest = Localize(world_.Log(run), "oracle.db");
    const auto misled = Show("fleet.db", honest.begin);
    const auto before = Show("oracle.db", honest.begin);
    for (const char* const store : {"fleet.db", "oracle.db"}) Return({honest}, store);
    const auto fleet = Show("fleet.db", honest.end);
    const auto oracle = Show("oracle.db", honest.end);
    std::set<std::string> seen;
    for (const VisitEvidence& visit : honest.evidence) {
      if (visit.observations >= 5) seen.insert(visit.signature.text());
    }
    for (const std::string& signature : seen) {
      for (const auto& [mode, probability] : oracle.at(signature)) {
        if (probability < 0.95) continue;
        ++judged;
        EXPECT_GT(fleet.at(signature).at(mode), 0.5) << "run " << run << ", " << signature;
        turned += before.at(signature).at(mode) > 0.5 && misled.at(signature).at(mode) < 0.5;
      }
    }
  }
  EXPECT_GT(judged, 30);
  fmt::print("{}: {} landmarks judged after a shift, {} of them turned before it\n",
             GetParam().name,
             judged,
             turned);
}

INSTANTIATE_TEST_SUITE_P(Faults,
                         WrongVehicleTest,
                         ::testing::Values(Fault{"frozen", 31},
                                           Fault{"frozen", 32},
                                           Fault{"reversed", 33},
                                           Fault{"reversed", 34},
                                           Fault{"lies", 35},
                                           Fault{"flood", 36}),
                         [](const auto& fault) {
                           return fault.param.name + std::to_string(fault.param.seed);
                         });

}  // namespace
}  // namespace shiftmap::testing
