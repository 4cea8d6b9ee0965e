// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/metrics.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "mapstore/server/json_log.h"

namespace shiftmap::server {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

TEST(MetricsTest, CallsAreCountedByCodeAndTheirTimesAddUp) {
  Metrics metrics;
  metrics.CountCall(Call::kSubmitReport, StatusCode::kOk, 0.0005);
  metrics.CountCall(Call::kSubmitReport, StatusCode::kOk, 0.03);
  metrics.CountCall(Call::kSubmitReport, StatusCode::kNotFound, 100.0);
  metrics.CountReport("accepted");
  const std::string text = metrics.Text({});
  EXPECT_THAT(text, HasSubstr("shiftmap_calls_total{call=\"SubmitReport\",code=\"OK\"} 2\n"));
  EXPECT_THAT(text, HasSubstr("code=\"NOT_FOUND\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("_bucket{call=\"SubmitReport\",le=\"0.001\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("_bucket{call=\"SubmitReport\",le=\"0.05\"} 2\n"));
  EXPECT_THAT(text, HasSubstr("_bucket{call=\"SubmitReport\",le=\"+Inf\"} 3\n"));
  EXPECT_THAT(text, HasSubstr("_count{call=\"SubmitReport\"} 3\n"));
  EXPECT_THAT(text, HasSubstr("shiftmap_reports_total{outcome=\"accepted\"} 1\n"));
  EXPECT_THAT(text, HasSubstr("shiftmap_reports_total{outcome=\"refused\"} 0\n"));
  EXPECT_EQ(metrics.calls(), 3);
}

TEST(MetricsTest, AHostileAreaStaysOneLabel) {
  const std::string text =
      Metrics().Text({{"shiftmap_x", "X.", {{"a\"} 1\nb\\\x1b[31m", 2.0}, {"", 3.0}}}});
  EXPECT_THAT(text, HasSubstr("shiftmap_x{area=\"a\\\"} 1\\\\nb\\\\\\\\x1b[31m\"} 2\n"));
  EXPECT_THAT(text, HasSubstr("\nshiftmap_x 3\n"));
  EXPECT_THAT(text, Not(HasSubstr("\x1b")));
}

TEST(JsonLogTest, EveryLineIsAnObjectWhateverItTells) {
  std::ostringstream out;
  JsonLog log(&out, JsonLog::Level::kInfo);
  log.Write(JsonLog::Level::kInfo, "call", {{"client", "a\n\"\x1b[31m\xff"}});
  log.Write(JsonLog::Level::kDebug, "call", {});
  std::istringstream lines(out.str());
  std::string line;
  ASSERT_TRUE(std::getline(lines, line));
  const Json read = Json::parse(line);
  EXPECT_EQ(read["level"], "info");
  EXPECT_EQ(read["event"], "call");
  EXPECT_THAT(read["client"].get<std::string>(), HasSubstr("a\n\"\x1b[31m"));
  EXPECT_THAT(line, Not(HasSubstr("\x1b")));
  EXPECT_FALSE(std::getline(lines, line));
}

}  // namespace
}  // namespace shiftmap::server
