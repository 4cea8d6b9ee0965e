// SPDX-License-Identifier: Apache-2.0
#include "mapstore/codec/shift_report.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <random>
#include <set>

namespace shiftmap {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

Stamp At(std::int64_t seconds) { return StampFromNanoseconds(seconds * 1'000'000'000 + 7); }

ShiftReport MakeReport() {
  ShiftReport report;
  report.uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
  report.vehicle = "truck 7";
  report.area = "level 3";
  report.version = VersionNumber(4);
  report.content_hash = std::string(64, 'a');
  report.run_hash = std::string(64, '0');
  report.run_uuid = "1f8fad5b-d9cb-469f-a165-70867728950e";
  report.software = "shiftmap-localizer 0.1.0";
  report.begin = At(100);
  report.end = At(200);
  report.evidence = {
      {Signature("18"), At(110), At(120), {{kAbsent, -3.5}, {ModeNumber(2), 0.1}}, 12},
      {Signature("7"), At(130), At(130), {{kAbsent, 0.0}}, 0}};
  report.decisions = {{Signature("18"), ModeNumber(2), At(115), 18.4}};
  UnmappedSighting sighting;
  sighting.signature = Signature("9");
  sighting.p_map_landmark = {1.25, -7.5};
  sighting.cov_p_map_landmark << 0.2, 0.05, 0.05, 0.1;
  sighting.count = 3;
  sighting.first = At(140);
  sighting.last = At(150);
  report.sightings = {sighting, sighting};
  report.sightings[1].signature = Signature();
  return report;
}

void ExpectEqual(const ShiftReport& got, const ShiftReport& expected) {
  EXPECT_EQ(got.uuid, expected.uuid);
  EXPECT_EQ(got.vehicle, expected.vehicle);
  EXPECT_EQ(got.area, expected.area);
  EXPECT_EQ(got.version, expected.version);
  EXPECT_EQ(got.content_hash, expected.content_hash);
  EXPECT_EQ(got.run_hash, expected.run_hash);
  EXPECT_EQ(got.run_uuid, expected.run_uuid);
  EXPECT_EQ(got.software, expected.software);
  EXPECT_EQ(got.begin, expected.begin);
  EXPECT_EQ(got.end, expected.end);
  ASSERT_EQ(got.evidence.size(), expected.evidence.size());
  for (std::size_t i = 0; i < got.evidence.size(); ++i) {
    const VisitEvidence& a = got.evidence[i];
    const VisitEvidence& b = expected.evidence[i];
    EXPECT_EQ(a.signature, b.signature);
    EXPECT_EQ(a.begin, b.begin);
    EXPECT_EQ(a.end, b.end);
    EXPECT_EQ(a.observations, b.observations);
    ASSERT_EQ(a.modes.size(), b.modes.size());
    for (std::size_t k = 0; k < a.modes.size(); ++k) {
      EXPECT_EQ(a.modes[k].mode, b.modes[k].mode);
      EXPECT_EQ(a.modes[k].log_likelihood, b.modes[k].log_likelihood);
    }
  }
  ASSERT_EQ(got.decisions.size(), expected.decisions.size());
  for (std::size_t i = 0; i < got.decisions.size(); ++i) {
    EXPECT_EQ(got.decisions[i].signature, expected.decisions[i].signature);
    EXPECT_EQ(got.decisions[i].mode, expected.decisions[i].mode);
    EXPECT_EQ(got.decisions[i].stamp, expected.decisions[i].stamp);
    EXPECT_EQ(got.decisions[i].log_odds, expected.decisions[i].log_odds);
  }
  ASSERT_EQ(got.sightings.size(), expected.sightings.size());
  for (std::size_t i = 0; i < got.sightings.size(); ++i) {
    EXPECT_EQ(got.sightings[i].signature, expected.sightings[i].signature);
    EXPECT_EQ(got.sightings[i].p_map_landmark, expected.sightings[i].p_map_landmark);
    EXPECT_EQ(got.sightings[i].cov_p_map_landmark, expected.sightings[i].cov_p_map_landmark);
    EXPECT_EQ(got.sightings[i].count, expected.sightings[i].count);
    EXPECT_EQ(got.sightings[i].first, expected.sightings[i].first);
    EXPECT_EQ(got.sightings[i].last, expected.sightings[i].last);
  }
}

TEST(ShiftReportCodec, RoundTripsAndIsDeterministic) {
  const ShiftReport report = MakeReport();
  const auto back = DecodeShiftReport(EncodeShiftReport(report));
  ASSERT_TRUE(back.ok()) << Message(back.status());
  ExpectEqual(*back, report);
  EXPECT_EQ(EncodeShiftReport(*back), EncodeShiftReport(report));
}

TEST(ShiftReportCodec, TakesALiveStreamAndAnEmptyShift) {
  ShiftReport report = MakeReport();
  report.run_hash.clear();
  report.evidence.clear();
  report.decisions.clear();
  report.sightings.clear();
  report.end = report.begin;
  EXPECT_TRUE(DecodeShiftReport(EncodeShiftReport(report)).ok());
}

TEST(ShiftReportCodec, NamesTheFieldThatIsWrong) {
  struct Case {
    std::string field;
    std::function<void(ShiftReport*)> spoil;
  };
  const std::vector<Case> cases = {
      {"uuid", [](auto* r) { r->uuid = ""; }},
      {"uuid", [](auto* r) { r->uuid[3] = 'g'; }},
      {"uuid", [](auto* r) { r->uuid[8] = '0'; }},
      {"vehicle", [](auto* r) { r->vehicle = ""; }},
      {"vehicle", [](auto* r) { r->vehicle = std::string(5000, 'v'); }},
      {"area", [](auto* r) { r->area = ""; }},
      {"software", [](auto* r) { r->software = ""; }},
      {"version", [](auto* r) { r->version = VersionNumber(0); }},
      {"content_hash", [](auto* r) { r->content_hash = "abc"; }},
      {"content_hash", [](auto* r) { r->content_hash[0] = 'g'; }},
      {"run_hash", [](auto* r) { r->run_hash = "0"; }},
      {"begin_ns", [](auto* r) { r->begin = At(201); }},
      {"evidence[0].signature", [](auto* r) { r->evidence[0].signature = Signature(); }},
      {"evidence[0]", [](auto* r) { r->evidence[0].begin = At(121); }},
      {"evidence[0]", [](auto* r) { r->evidence[0].begin = At(99); }},
      {"evidence[1]", [](auto* r) { r->evidence[1].end = At(201); }},
      {"evidence[1].observation_count", [](auto* r) { r->evidence[1].observations = -1; }},
      {"evidence[1].mode", [](auto* r) { r->evidence[1].modes.clear(); }},
      {"evidence[0].mode", [](auto* r) { r->evidence[0].modes[0].mode = ModeNumber(1); }},
      {"evidence[0].mode[1].mode", [](auto* r) { r->evidence[0].modes[1].mode = kAbsent; }},
      {"evidence[0].mode[1].log_likelihood",
       [](auto* r) { r->evidence[0].modes[1].log_likelihood = kNan; }},
      {"decision[0].signature", [](auto* r) { r->decisions[0].signature = Signature(); }},
      {"decision[0].mode", [](auto* r) { r->decisions[0].mode = ModeNumber(-1); }},
      {"decision[0].log_odds", [](auto* r) { r->decisions[0].log_odds = kInfinity; }},
      {"decision[0].stamp_ns", [](auto* r) { r->decisions[0].stamp = At(99); }},
      {"sighting[1].x_m", [](auto* r) { r->sightings[1].p_map_landmark.x() = kNan; }},
      {"sighting[1].y_m", [](auto* r) { r->sightings[1].p_map_landmark.y() = -kInfinity; }},
      {"sighting[0]", [](auto* r) { r->sightings[0].cov_p_map_landmark.setZero(); }},
      {"sighting[0]", [](auto* r) { r->sightings[0].cov_p_map_landmark(1, 1) = kNan; }},
      {"sighting[0].count", [](auto* r) { r->sightings[0].count = 0; }},
      {"sighting[0]", [](auto* r) { r->sightings[0].first = At(151); }},
  };
  for (const Case& c : cases) {
    ShiftReport report = MakeReport();
    c.spoil(&report);
    const Status status = DecodeShiftReport(EncodeShiftReport(report)).status();
    EXPECT_EQ(status.code(), StatusCode::kInvalidArgument) << c.field;
    EXPECT_TRUE(Message(status).starts_with(c.field)) << c.field << ": " << Message(status);
  }
}

TEST(ShiftReportCodec, EveryTruncationIsAnError) {
  const std::string bytes = EncodeShiftReport(MakeReport());
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    const auto report = DecodeShiftReport(bytes.substr(0, length));
    EXPECT_EQ(report.status().code(), StatusCode::kInvalidArgument) << length;
  }
}

// Vehicles one release behind do not say how many items there are.
TEST(ShiftReportCodec, TakesAReportThatDoesNotCountItsItems) {
  const ShiftReport report = MakeReport();
  const std::string bytes = EncodeShiftReport(report);
  constexpr std::size_t kCount = 2;  // Tag and value.
  const auto decoded = DecodeShiftReport(bytes.substr(kCount));
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  ExpectEqual(*decoded, report);
}

TEST(ShiftReportCodec, GarbageIsAnErrorOrAValidReport) {
  std::mt19937 random(40);
  const std::string bytes = EncodeShiftReport(MakeReport());
  testing::internal::CaptureStderr();
  for (int trial = 0; trial < 20'000; ++trial) {
    std::string garbage = bytes;
    for (unsigned i = random() % 4 + 1; i > 0; --i) {
      garbage[random() % garbage.size()] = static_cast<char>(random());
    }
    const auto report = DecodeShiftReport(garbage);
    if (report.ok()) {
      EXPECT_TRUE(DecodeShiftReport(EncodeShiftReport(*report)).ok());
    } else {
      EXPECT_EQ(report.status().code(), StatusCode::kInvalidArgument);
    }
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");  // Text that is not UTF-8 included.
}

TEST(ShiftReportFile, RoundTripsAndNamesTheFile) {
  std::string folder = (std::filesystem::temp_directory_path() / "shiftmap_XXXXXX").string();
  ASSERT_NE(mkdtemp(folder.data()), nullptr);
  const std::string path = folder + "/shift.report";
  const std::string prefix = "shift report '" + path + "': ";

  EXPECT_EQ(ReadShiftReport(path).status().code(), StatusCode::kNotFound);
  EXPECT_TRUE(Message(ReadShiftReport(path).status()).starts_with(prefix));

  ASSERT_TRUE(WriteShiftReport(MakeReport(), path).ok());
  const auto report = ReadShiftReport(path);
  ASSERT_TRUE(report.ok()) << Message(report.status());
  ExpectEqual(*report, MakeReport());

  std::ofstream(path) << "something else";
  EXPECT_EQ(ReadShiftReport(path).status().code(), StatusCode::kInvalidArgument);
  EXPECT_TRUE(Message(ReadShiftReport(path).status()).starts_with(prefix));
  EXPECT_EQ(ReadShiftReport(folder).status().code(), StatusCode::kInvalidArgument);

  ShiftReport wrong = MakeReport();
  wrong.uuid = "none";
  const Status status = WriteShiftReport(wrong, path);
  EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
  EXPECT_TRUE(Message(status).starts_with(prefix + "uuid")) << Message(status);
  std::filesystem::remove_all(folder);
}

TEST(RandomUuid, IsVersion4AndUnique) {
  std::set<std::string> uuids;
  for (int i = 0; i < 1000; ++i) {
    const std::string uuid = RandomUuid();
    ASSERT_EQ(uuid.size(), 36U);
    EXPECT_EQ(uuid[14], '4');
    EXPECT_NE(std::string("89ab").find(uuid[19]), std::string::npos);
    ShiftReport report = MakeReport();
    report.uuid = uuid;
    EXPECT_TRUE(DecodeShiftReport(EncodeShiftReport(report)).ok());
    uuids.insert(uuid);
  }
  EXPECT_EQ(uuids.size(), 1000U);
}

}  // namespace
}  // namespace shiftmap
