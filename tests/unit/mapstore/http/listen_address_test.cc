// SPDX-License-Identifier: Apache-2.0
#include "mapstore/http/listen_address.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

TEST(ListenAddressTest, IsAHostAndAPort) {
  const auto v4 = ParseListenAddress("--x", "127.0.0.1:8080");
  ASSERT_THAT(v4, IsOk());
  EXPECT_EQ(v4->Text(), "127.0.0.1:8080");
  EXPECT_EQ(v4->Url(), "http://127.0.0.1:8080/");
  const auto v6 = ParseListenAddress("--x", "[::1]:0");
  ASSERT_THAT(v6, IsOk());
  EXPECT_EQ(v6->host, "::1");
  EXPECT_EQ(v6->Url(), "http://[::1]:0/");
  EXPECT_EQ(ParseListenAddress("--x", "9464", "127.0.0.1")->Text(), "127.0.0.1:9464");
  for (const char* text : {"",
                           "a",
                           ":1",
                           "a:",
                           "a:65536",
                           "a:-1",
                           "a:1x",
                           "::1:2",
                           "[::1:80",
                           "127.0.0.1",
                           "9464",
                           "a:80 "}) {
    EXPECT_THAT(ParseListenAddress("--x", text), StatusIs(StatusCode::kInvalidArgument, "--x"));
  }
}

TEST(ListenAddressTest, ANameIsNoAddress) {
  for (const char* text : {"localhost:0", "127.0.0.1:0", "[::1]:0", "10.0.0.1:0"}) {
    EXPECT_TRUE(ParseListenAddress("--x", text)->IsAddress()) << text;
  }
  for (const char* text : {"host:80", "1.2.3:80", "1.2.3.4.example:80"}) {
    EXPECT_FALSE(ParseListenAddress("--x", text)->IsAddress()) << text;
  }
}

TEST(ListenAddressTest, IsOnlyReachedFromThisMachineIfItIsLoopback) {
  for (const char* text : {"localhost:0", "127.0.0.1:0", "127.8.8.8:0", "[::1]:0"}) {
    EXPECT_TRUE(ParseListenAddress("--x", text)->IsLoopback()) << text;
  }
  for (const char* text :
       {"0.0.0.0:0", "10.0.0.1:0", "128.0.0.1:0", "127.example.com:1", "[::]:0", "[::2]:0"}) {
    EXPECT_FALSE(ParseListenAddress("--x", text)->IsLoopback()) << text;
  }
}

}  // namespace
}  // namespace shiftmap
