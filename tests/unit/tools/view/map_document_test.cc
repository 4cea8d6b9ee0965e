// SPDX-License-Identifier: Apache-2.0
#include "tools/view/map_document.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>

#include "mapstore/core/clock.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tools/plot/free_network.h"
#include "tools/view/compact_values.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

class MapDocumentTest : public ::testing::Test {
 protected:
  void Commit(const testing::RandomMapOptions& options, int versions) {
    content_ = testing::RandomContent(random_, options);
    for (int i = runs_; i < runs_ + versions; ++i) {
      Provenance provenance{"<tool>", "", 0, {}};
      provenance.runs.push_back(RunRecord{.name = fmt::format("run_{:03}", i),
                                          .sha256 = fmt::format("{:064x}", i),
                                          .vehicle = "truck-\x1b[0m",
                                          .begin = content_.stamp,
                                          .end = content_.stamp,
                                          .trajectory = {}});
      for (int pose = 0; pose < 2000; ++pose) {
        provenance.runs[0].trajectory.push_back(
            {content_.stamp + FromSeconds(0.1 * pose), Se2(0.5 * pose, -0.25 * pose, 0.0)});
      }
      CommitOptions commit{.parent = version_, .states_probabilities = false};
      const auto result = store_.Commit("hall", content_, provenance, commit);
      ASSERT_THAT(result, IsOk());
      version_ = result->version;
      content_hash_ = result->content_hash;
    }
    runs_ += versions;
  }

  void Return(int number, int visits) {
    ShiftReport report;
    report.uuid = fmt::format("00000000-0000-4000-8000-{:012}", number);
    report.vehicle = fmt::format("truck-{}", number % 4);
    report.area = "hall";
    report.version = *version_;
    report.content_hash = content_hash_;
    report.software = "test";
    report.begin = content_.stamp + FromSeconds(40'000.0 * number);
    report.end = report.begin + FromSeconds(30'000.0);
    for (int i = 0; i < visits; ++i) {
      const LandmarkGroup& group = content_.groups[random_() % content_.groups.size()];
      const Stamp begin = report.begin + FromSeconds(29'000.0 * i / visits);
      report.evidence.push_back(
          testing::RandomEvidence(random_, group, begin, begin + FromSeconds(20.0)));
    }
    ASSERT_THAT(store_.Return(report), IsOk());
  }

  // Moves the map by (700, -40) m.
  MapEdit Control() const {
    const LandmarkGroup& group = content_.groups[0];
    MapEdit control;
    control.kind = EditKind::kControl;
    control.author = control.reason = "test";
    control.signature = group.signature;
    control.mode = group.modes[0].number;
    control.p_map_landmark = group.modes[0].p_map_landmark + Eigen::Vector2d(700.0, -40.0);
    control.sd_m = 0.02;
    return control;
  }

  std::mt19937_64 random_{testing::TestSeed(3)};
  testing::TempDir dir_;
  Stamp clock_ = SystemNow();
  MapStore store_ = *MapStore::Open(
      dir_.File("a.db"),
      {.access = MapStore::Access::kReadWriteCreate, .clock = [this] { return clock_; }});
  MapContent content_;
  std::optional<VersionNumber> version_;
  std::string content_hash_;
  int runs_ = 0;
};

TEST_F(MapDocumentTest, HasEveryModeToATenthOfAMillimetre) {
  ASSERT_NO_FATAL_FAILURE(Commit({.groups = 8}, 2));
  const auto document = MapDocument("hall", {}, &store_);
  ASSERT_THAT(document, IsOk());
  EXPECT_EQ((*document)["shown"], 2);
  ASSERT_EQ((*document)["maps"].size(), 2U);
  const Json& groups = (*document)["maps"][0][1];
  ASSERT_EQ(groups.size(), content_.groups.size());
  for (std::size_t g = 0; g < groups.size(); ++g) {
    const LandmarkGroup& group = content_.groups[g];
    EXPECT_EQ((*document)["signatures"][groups[g][0].get<std::size_t>()], group.signature.text());
    const Json& modes = groups[g][2];
    ASSERT_EQ(modes.size(), 7 * group.modes.size());
    for (std::size_t i = 0; i < group.modes.size(); ++i) {
      const Mode& mode = group.modes[i];
      EXPECT_EQ(modes[7 * i], mode.number.value());
      EXPECT_NEAR(1e-4 * modes[7 * i + 1].get<double>(), mode.p_map_landmark.x(), 5.1e-5);
      EXPECT_NEAR(1e-4 * modes[7 * i + 2].get<double>(), mode.p_map_landmark.y(), 5.1e-5);
      const double major = 1e-4 * modes[7 * i + 3].get<double>();
      const double minor = 1e-4 * modes[7 * i + 4].get<double>();
      EXPECT_NEAR(
          major * major + minor * minor, mode.cov_p_map_landmark.trace(), 2e-4 * major + 1e-8);
    }
  }
}

// The ellipses of pictures, of each version in the frame of the one that is shown.
TEST_F(MapDocumentTest, HasTheFreeNetworkOfEachVersion) {
  ASSERT_NO_FATAL_FAILURE(Commit({.groups = 12, .cross_block_share = 0.9}, 1));
  const MapEdit control = Control();
  ASSERT_THAT(store_.Edit("hall", control), IsOk());
  const auto document = MapDocument("hall", {}, &store_);
  ASSERT_THAT(document, IsOk());
  ASSERT_EQ((*document)["maps"].size(), 2U);
  const Json& parent = (*document)["maps"][1];
  const FreeMap free = FreeNetwork(content_);
  ASSERT_EQ(parent[3].size(), 1U + 3U * static_cast<std::size_t>(content_.covariance.size()));
  EXPECT_NEAR(parent[3][0].get<double>(), free.scale_sd, 0.06 * free.scale_sd);
  std::size_t at = 1;
  for (const LandmarkGroup& freed : free.content.groups) {
    for (const Mode& mode : freed.modes) {
      const double major = 1e-4 * parent[3][at].get<double>();
      const double minor = 1e-4 * parent[3][at + 1].get<double>();
      EXPECT_NEAR(std::hypot(major, minor), std::sqrt(mode.cov_p_map_landmark.trace()), 2e-4);
      at += 3;
    }
  }
}

TEST_F(MapDocumentTest, NamesAreInert) {
  ASSERT_NO_FATAL_FAILURE(Commit({.groups = 2}, 1));
  const auto document = MapDocument("hall", {}, &store_);
  ASSERT_THAT(document, IsOk());
  EXPECT_EQ((*document)["vehicles"], Json::array({"truck-\\x1b[0m"}));
}

// The page runs the chains of the version that is shown, and no other.
TEST_F(MapDocumentTest, HasTheRhythmsOfTheShownVersion) {
  ASSERT_NO_FATAL_FAILURE(Commit({.groups = 4, .rhythms = 2}, 2));
  const auto document = MapDocument("hall", {}, &store_);
  ASSERT_THAT(document, IsOk());
  const Json& groups = (*document)["maps"][0][1];
  for (std::size_t g = 0; g < 2; ++g) {
    ASSERT_EQ(groups[g].size(), 5U);
    const Json& row = groups[g][4];
    const ChainRhythm& rhythm = *content_.groups[g].chain.rhythm();
    EXPECT_EQ(row[0], ToSeconds(rhythm.calendar().period));
    std::size_t at = 1;
    for (const Eigen::MatrixXd& rates : rhythm.rate_matrices()) {
      for (Eigen::Index from = 0; from < rates.rows(); ++from) {
        for (Eigen::Index to = 0; to < rates.cols(); ++to) {
          if (from == to) continue;
          ASSERT_LT(at, row.size());
          EXPECT_NEAR(row[at++].get<double>(), rates(from, to), 6e-5 * rates(from, to));
        }
      }
    }
    EXPECT_EQ(at, row.size());
  }
  EXPECT_EQ(groups[2].size(), 4U);
  EXPECT_EQ((*document)["maps"][1][1][0].size(), 4U);
}

TEST_F(MapDocumentTest, SaysWhichRhythmsAreLeftOut) {
  ASSERT_NO_FATAL_FAILURE(Commit({.groups = 3, .max_modes = 1, .rhythms = 3}, 1));
  // Of two states: 2 rates an hour. The second one is that of a week.
  const auto document = MapDocument("hall", {.max_rhythm_rates = 100}, &store_);
  ASSERT_THAT(document, IsOk());
  const Json& groups = (*document)["maps"][0][1];
  EXPECT_EQ(groups[0][4].size(), 49U);
  EXPECT_EQ(groups[1][4], Json::array({604800.0}));
  EXPECT_EQ(groups[2][4].size(), 49U);
}

TEST_F(MapDocumentTest, OfTenThousandModesWithALongPastIsBelowFiveMegabytes) {
  ASSERT_NO_FATAL_FAILURE(
      Commit({.groups = 4000, .max_modes = 4, .rhythms = 100, .cross_block_share = 0.2}, 6));
  for (int shift = 0; shift < 12; ++shift) ASSERT_NO_FATAL_FAILURE(Return(shift, 5000));
  const auto document = MapDocument("hall", {}, &store_);
  ASSERT_THAT(document, IsOk());
  EXPECT_GT(content_.covariance.size(), 9'700);
  const std::size_t bytes = document->dump().size();
  std::printf("%zu modes, 60000 visits: %.2f MB\n",
              static_cast<std::size_t>(content_.covariance.size()),
              static_cast<double>(bytes) / 1e6);
  EXPECT_LT(bytes, 4'700'000U);
  // What is left out is told.
  EXPECT_TRUE((*document)["left_out"].contains("before_s"));
  EXPECT_GT((*document)["left_out"]["versions"], 0);
}

// A control point moves the map: what earlier versions hold is drawn where the map is now.
TEST_F(MapDocumentTest, EarlierRunsAndVersionsAreInTheFrameOfTheOneThatIsShown) {
  ASSERT_NO_FATAL_FAILURE(Commit({.groups = 5}, 2));
  const MapEdit control = Control();
  ASSERT_THAT(store_.Edit("hall", control), IsOk());
  MapEdit rename = control;
  rename.kind = EditKind::kRename;
  rename.new_name = Signature("zz");
  ASSERT_THAT(store_.Edit("hall", rename), IsOk());
  const auto document = MapDocument("hall", {}, &store_);
  ASSERT_THAT(document, IsOk());
  ASSERT_EQ((*document)["runs"].size(), 2U);
  for (const Json& run : (*document)["runs"]) {
    EXPECT_NEAR(run[5][0].get<double>(), 70'000.0, 1.0);  // [cm]
    EXPECT_NEAR(run[5][1].get<double>(), -4'000.0, 1.0);
  }
  // All versions have the same modes, to the tenth of a millimetre.
  ASSERT_EQ((*document)["maps"].size(), 4U);
  for (const Json& map : (*document)["maps"]) {
    for (std::size_t g = 0; g < map[1].size(); ++g) {
      const Json& modes = map[1][g][2];
      const Json& shown = (*document)["maps"][0][1][g][2];
      EXPECT_EQ(map[1][g][0], (*document)["maps"][0][1][g][0]);
      EXPECT_NEAR(modes[1].get<double>(), shown[1].get<double>(), 1.0);
      EXPECT_NEAR(modes[2].get<double>(), shown[2].get<double>(), 1.0);
    }
  }
}

// As it was before the second version was made: it, and all that came later, is not there.
TEST_F(MapDocumentTest, WhatWasKnownIsAPageToo) {
  ASSERT_NO_FATAL_FAILURE(Commit({.groups = 5}, 1));
  const Stamp between = clock_;
  clock_ += FromSeconds(100.0);
  ASSERT_NO_FATAL_FAILURE(Return(0, 20));
  ASSERT_NO_FATAL_FAILURE(Commit({.groups = 5}, 1));
  const auto before = MapDocument("hall", {.known = between}, &store_);
  ASSERT_THAT(before, IsOk());
  EXPECT_EQ((*before)["shown"], 1);
  EXPECT_EQ((*before)["published"], 1);
  EXPECT_EQ((*before)["versions"].size(), 1U);
  EXPECT_EQ((*before)["known_s"], ToSecondsSinceEpoch(between));
  for (const Json& visits : (*before)["visits"]) {
    for (const Json& visit : visits) EXPECT_EQ(visit[11], Describe(SetAside::kUnknown));
  }
  EXPECT_EQ((*MapDocument("hall", {}, &store_))["shown"], 2);
}

TEST_F(MapDocumentTest, AVersionThatIsNotThereIsAnError) {
  ASSERT_NO_FATAL_FAILURE(Commit({.groups = 2}, 1));
  EXPECT_THAT(MapDocument("hall", {.version = VersionNumber(7)}, &store_),
              StatusIs(StatusCode::kNotFound, "version 7"));
  EXPECT_THAT(MapDocument("yard", {}, &store_), StatusIs(StatusCode::kNotFound, "yard"));
}

TEST(TextTable, KeepsApartTextsThatLookAlike) {
  TextTable table;
  EXPECT_EQ(table.Add("a\x1b"), 0);
  EXPECT_EQ(table.Add("a\\x1b"), 1);
  EXPECT_EQ(table.Add("a\x1b"), 0);
  EXPECT_EQ(table.TakeJson(), Json::array({"a\\x1b", "a\\x1b"}));
}

}  // namespace
}  // namespace shiftmap
