// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/shift_report_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

using ::shiftmap::testing::IsOk;
using ::shiftmap::testing::StatusIs;

Stamp At(double seconds) { return StampFromSeconds(seconds); }

VisitEvidence Visit(const std::string& signature, double begin_s, double log_likelihood) {
  return {.signature = Signature(signature),
          .begin = At(begin_s),
          .end = At(begin_s + 1.0),
          .modes = {{kAbsent, log_likelihood}, {ModeNumber(1), 0.0}},
          .observations = 3};
}

UnmappedSighting Sighting(const std::string& signature, std::int64_t count) {
  UnmappedSighting sighting;
  sighting.signature = Signature(signature);
  sighting.cov_p_map_landmark.setIdentity();
  sighting.count = count;
  sighting.first = sighting.last = At(150.0);
  return sighting;
}

ShiftReport Report() {
  ShiftReport report;
  report.uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
  report.vehicle = "truck";
  report.area = "hall";
  report.version = VersionNumber(1);
  report.content_hash = std::string(64, 'a');
  report.software = "test";
  report.begin = At(100.0);
  report.end = At(200.0);
  report.evidence = {Visit("a", 110.0, -50.0), Visit("b", 110.0, -1.0), Visit("a", 120.0, -1.0)};
  report.decisions = {{Signature("a"), ModeNumber(1), At(111.0), 9.0},
                      {Signature("b"), kAbsent, At(111.0), 9.0}};
  report.sightings = {Sighting("new", 2), Sighting("", 1), Sighting("other", 9)};
  return report;
}

struct Spoiled {
  const char* message;
  const char* reason;
  std::function<void(ShiftReport*)> spoil;
};

std::vector<Spoiled> SpoiledItems() {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  return {
      {"log_likelihood: -1e+300",
       "invalid_evidence",
       [](auto* r) { r->evidence[1].modes[0].log_likelihood = -1e300; }},
      {"expected at most 50 apart",
       "invalid_evidence",
       [](auto* r) { r->evidence[1].modes[0].log_likelihood = -50.1; }},
      {"log_likelihood: nan",
       "invalid_evidence",
       [](auto* r) { r->evidence[1].modes[0].log_likelihood = kNan; }},
      {"signature: is not UTF-8",
       "invalid_evidence",
       [](auto* r) { r->evidence[1].signature = Signature("\xff"); }},
      {"within", "invalid_evidence", [](auto* r) { r->evidence[1].begin = Stamp::min(); }},
      {"another visit of 'a' at the same time",
       "invalid_evidence",
       [](auto* r) { r->evidence[1].signature = Signature("a"); }},
      {"log_odds", "invalid_decision", [](auto* r) { r->decisions[1].log_odds = -1e10; }},
      {"x_m", "invalid_sighting", [](auto* r) { r->sightings[1].p_map_landmark.x() = 1e10; }},
      {"covariance",
       "invalid_sighting",
       [](auto* r) { r->sightings[1].cov_p_map_landmark(0, 0) = -1.0; }},
      {"covariance",
       "invalid_sighting",
       [](auto* r) { r->sightings[1].cov_p_map_landmark *= 1e19; }},
      {"signature: is not UTF-8",
       "invalid_sighting",
       [](auto* r) { r->sightings[1].signature = Signature("\xc3\x28"); }},
  };
}

TEST(ValidateShiftReport, NamesWhatIsBeyondItsBounds) {
  EXPECT_THAT(ValidateShiftReport(Report()), IsOk());
  for (const Spoiled& c : SpoiledItems()) {
    ShiftReport report = Report();
    c.spoil(&report);
    EXPECT_THAT(ValidateShiftReport(report), StatusIs(StatusCode::kInvalidArgument, c.message));
  }
  ShiftReport report = Report();
  report.begin = Stamp::min();
  EXPECT_THAT(ValidateShiftReport(report), StatusIs(StatusCode::kInvalidArgument, "1970"));
  report = Report();
  report.end = Stamp::max();
  EXPECT_THAT(ValidateShiftReport(report), StatusIs(StatusCode::kInvalidArgument, "1970"));
}

TEST(LeaveOutInvalid, TakesOutTheItemAndCountsIt) {
  for (const Spoiled& c : SpoiledItems()) {
    SCOPED_TRACE(c.message);
    ShiftReport report = Report();
    report.dropped = {{"late", 7}};
    c.spoil(&report);
    LeaveOutInvalid(&report);
    EXPECT_THAT(ValidateShiftReport(report), IsOk());
    EXPECT_EQ(report.evidence.size() + report.decisions.size() + report.sightings.size(), 7U);
    ASSERT_EQ(report.dropped.size(), 2U);
    EXPECT_EQ(report.dropped[0].count, 7);
    EXPECT_EQ(report.dropped[1].reason, c.reason);
    EXPECT_EQ(report.dropped[1].count, 1);
  }
  ShiftReport sound = Report();
  LeaveOutInvalid(&sound);
  EXPECT_EQ(sound.evidence.size(), 3U);
  EXPECT_TRUE(sound.dropped.empty());
}

TEST(LeaveOutInvalid, TakesOutTheLeastValuableItemsOfATooLargeReport) {
  std::vector<std::size_t> left;
  for (std::size_t max_bytes = 18'000; max_bytes > 16'000; --max_bytes) {
    ShiftReport report = Report();
    LeaveOutInvalid(&report, max_bytes);
    EXPECT_THAT(ValidateShiftReport(report), IsOk());
    const std::size_t items =
        report.evidence.size() + report.decisions.size() + report.sightings.size();
    if (!left.empty() && items == left.back()) continue;
    left.push_back(items);
    // The sighting that was seen most goes after the others, and evidence last.
    if (items == 6) {
      ASSERT_EQ(report.sightings.size(), 1U);
      EXPECT_EQ(report.sightings[0].signature.text(), "other");
    }
    if (items == 3) {
      EXPECT_EQ(report.evidence.size(), 3U);
    }
  }
  EXPECT_EQ(left, (std::vector<std::size_t>{8, 7, 6, 5, 4, 3, 2, 1, 0}));
}

}  // namespace
}  // namespace shiftmap
