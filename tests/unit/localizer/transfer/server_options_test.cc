// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/server_options.h"

#include <gtest/gtest.h>

namespace shiftmap::transfer {
namespace {

ServerOptions PlainText(const std::string& address) {
  ServerOptions options;
  options.address = address;
  options.development_plain_text = true;
  return options;
}

TEST(ServerOptionsTest, PlainTextStaysOnThisHost) {
  for (const char* address : {"127.0.0.1:7443", "localhost:1", "[::1]:65535"}) {
    EXPECT_EQ(CheckServerOptions(PlainText(address)), "") << address;
  }
  for (const char* address : {"maps.example.com:7443", "10.0.0.1:7443", "0.0.0.0:7443"}) {
    EXPECT_NE(CheckServerOptions(PlainText(address)).find(address), std::string::npos) << address;
  }
}

TEST(ServerOptionsTest, AnAddressHasHostAndPort) {
  for (const char* address : {"",
                              "127.0.0.1",
                              ":7443",
                              "127.0.0.1:",
                              "127.0.0.1:0",
                              "127.0.0.1:65536",
                              "127.0.0.1:74x"}) {
    EXPECT_NE(CheckServerOptions(PlainText(address)).find("HOST:PORT"), std::string::npos)
        << address;
  }
}

TEST(ServerOptionsTest, CertificatesAreAllOrPlainText) {
  ServerOptions options;
  options.address = "maps.example.com:7443";
  EXPECT_EQ(CheckServerOptions(options), "give --tls-ca, --tls-cert and --tls-key");
  options.tls_ca = "ca.pem";
  options.tls_cert = "cert.pem";
  EXPECT_NE(CheckServerOptions(options), "");
  options.tls_key = "key.pem";
  EXPECT_EQ(CheckServerOptions(options), "");
  options.address = "localhost:7443";
  options.development_plain_text = true;
  EXPECT_NE(CheckServerOptions(options), "");
}

}  // namespace
}  // namespace shiftmap::transfer
