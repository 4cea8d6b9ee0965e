// SPDX-License-Identifier: Apache-2.0
#include "tools/view/view_server.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>

#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

TEST(HostHeader, NamesTheServerByAddressOrByAnOwnNameOnly) {
  std::array<char, 256> name = {};
  ASSERT_EQ(gethostname(name.data(), name.size() - 1), 0);
  for (const std::string& host : {std::string("127.0.0.1"),
                                  std::string("127.0.0.1:80"),
                                  std::string("[::1]:8080"),
                                  std::string("10.1.2.3:80"),
                                  std::string("localhost:80"),
                                  std::string("LocalHost"),
                                  std::string(name.data())}) {
    EXPECT_TRUE(IsOwnHost(host)) << host;
  }
  for (const char* host : {"",
                           "evil.example",
                           "evil.example:80",
                           "127.0.0.1.evil.example",
                           "localhost.evil.example:80",
                           "[::1",
                           "127.0.0.1:80:80",
                           "localhost:x"}) {
    EXPECT_FALSE(IsOwnHost(host)) << host;
  }
}

TEST(ViewServer, AnAddressThatIsTakenIsAnError) {
  const auto page = [] { return StatusOr<std::string>("page"); };
  const auto first = ViewServer::Start({"127.0.0.1", 0}, page);
  ASSERT_THAT(first, IsOk());
  EXPECT_GT(first->address().port, 0);
  EXPECT_THAT(ViewServer::Start(first->address(), page),
              StatusIs(StatusCode::kUnavailable, "cannot listen on http://127.0.0.1:"));
}

}  // namespace
}  // namespace shiftmap
