// SPDX-License-Identifier: Apache-2.0
#include "tools/view/view_page.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/support/status_matchers.h"
#include "tools/view/page_template.h"

namespace shiftmap {
namespace {

using ::testing::EndsWith;
using testing::IsOk;
using ::testing::StartsWith;
using testing::StatusIs;

std::string DataOf(const std::string& page) {
  const PageTemplate& around = ViewPageTemplate();
  return page.substr(around.head.size(), page.size() - around.head.size() - around.tail.size());
}

TEST(ViewPage, HoldsTheDocumentBetweenItsTwoParts) {
  if (!ViewPageTemplate().built()) GTEST_SKIP() << "this build has no web view";
  const Json document = {{"area", "hall"}, {"values", {1, 2.5, -3}}};
  const auto page = ViewPage(document);
  ASSERT_THAT(page, IsOk());
  EXPECT_THAT(*page, StartsWith("<!DOCTYPE html>"));
  EXPECT_THAT(ViewPageTemplate().head, EndsWith("<script type=\"application/json\" id=\"data\">"));
  EXPECT_THAT(ViewPageTemplate().tail, StartsWith("</script>"));
  EXPECT_EQ(Json::parse(DataOf(*page)), document);
}

TEST(ViewPage, TextOfTheDocumentCannotEndItsElement) {
  if (!ViewPageTemplate().built()) GTEST_SKIP() << "this build has no web view";
  const Json document = {"</script><script>alert(1)</script>",
                         "<!--<script>",
                         "]]>",
                         "\u2028\u2029 \u00e4 \U0001F600",
                         "\x1b[31m\x07",
                         "{{DATA}}"};
  const auto page = ViewPage(document);
  ASSERT_THAT(page, IsOk());
  const std::string data = DataOf(*page);
  EXPECT_EQ(data.find_first_of("<>&\x1b"), std::string::npos);
  for (const char c : data) EXPECT_LT(static_cast<unsigned char>(c), 0x80);
  EXPECT_EQ(Json::parse(data), document);
}

TEST(ViewPage, BytesThatAreNoTextBecomeAReplacementCharacter) {
  if (!ViewPageTemplate().built()) GTEST_SKIP() << "this build has no web view";
  const auto page = ViewPage(Json::array({"a\xff<"}));
  ASSERT_THAT(page, IsOk());
  EXPECT_EQ(Json::parse(DataOf(*page)), Json::array({"a\uFFFD<"}));
}

TEST(ViewPage, ABuildWithoutItSaysSo) {
  if (ViewPageTemplate().built()) GTEST_SKIP() << "this build has the web view";
  EXPECT_THAT(ViewPage(Json::object()),
              StatusIs(StatusCode::kFailedPrecondition, "this build has no web view"));
}

}  // namespace
}  // namespace shiftmap
