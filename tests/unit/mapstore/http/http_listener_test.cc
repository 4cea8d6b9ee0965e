// SPDX-License-Identifier: Apache-2.0
#include "mapstore/http/http_listener.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <array>

#include "mapstore/core/owned_fd.h"
#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

using ::testing::AllOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using testing::IsOk;
using ::testing::Not;
using ::testing::StartsWith;
using testing::StatusIs;

// What comes back until the listener closes the connection.
std::string Exchange(int port, const std::string& request) {
  const OwnedFd socket(::socket(AF_INET, SOCK_STREAM, 0));
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(connect(socket.get(), reinterpret_cast<sockaddr*>(&address), sizeof(address)), 0);
  EXPECT_EQ(send(socket.get(), request.data(), request.size(), MSG_NOSIGNAL),
            static_cast<ssize_t>(request.size()));
  std::string answer;
  std::array<char, 4096> buffer;
  for (ssize_t got = 0; (got = recv(socket.get(), buffer.data(), buffer.size(), 0)) > 0;) {
    answer.append(buffer.data(), static_cast<std::size_t>(got));
  }
  return answer;
}

class HttpListenerTest : public ::testing::Test {
 protected:
  HttpListenerTest()
      : listener_(HttpListener::Start({"127.0.0.1", 0},
                                      [](const HttpRequest& request) {
                                        HttpResponse response(200,
                                                              request.path + " at " + request.host);
                                        response.headers = {{"X-Own", "1"}};
                                        return response;
                                      },
                                      {{"X-Common", "2"}})) {}

  std::string Ask(const std::string& first_line, const std::string& headers = "") {
    return Exchange(
        listener_->address().port,
        first_line + " HTTP/1.1\r\nHost: mine\r\nConnection: close\r\n" + headers + "\r\n");
  }

  StatusOr<HttpListener> listener_;
};

TEST_F(HttpListenerTest, AnswersGetAndHead) {
  ASSERT_THAT(listener_, IsOk());
  EXPECT_GT(listener_->address().port, 0);
  const auto heads = AllOf(StartsWith("HTTP/1.1 200 "),
                           HasSubstr("Content-Type: text/plain; charset=utf-8\r\n"),
                           HasSubstr("X-Own: 1\r\n"),
                           HasSubstr("X-Common: 2\r\n"));
  EXPECT_THAT(Ask("GET /a"), AllOf(heads, EndsWith("\r\n\r\n/a at mine")));
  EXPECT_THAT(Ask("HEAD /a"), AllOf(heads, EndsWith("\r\n\r\n")));
}

TEST_F(HttpListenerTest, RefusesWhatItDoesNotServe) {
  ASSERT_THAT(listener_, IsOk());
  EXPECT_THAT(Ask("POST /a"),
              AllOf(StartsWith("HTTP/1.1 405 "),
                    HasSubstr("Allow: GET, HEAD\r\n"),
                    HasSubstr("X-Common: 2\r\n"),
                    Not(HasSubstr("X-Own"))));
  EXPECT_THAT(Ask("GET /a", "Content-Length: 5\r\n"), StartsWith("HTTP/1.1 400 "));
  EXPECT_THAT(Ask("GET /a", "Transfer-Encoding: chunked\r\n"), StartsWith("HTTP/1.1 400 "));
  EXPECT_THAT(Ask("GET /a", "X: " + std::string(20000, 'x') + "\r\n"), StartsWith("HTTP/1.1 431 "));
  EXPECT_THAT(Ask("GET /a"), StartsWith("HTTP/1.1 200 "));
}

TEST_F(HttpListenerTest, AnAddressThatIsTakenOrNoneIsAnError) {
  ASSERT_THAT(listener_, IsOk());
  const auto handler = [](const HttpRequest&) { return HttpResponse(200, ""); };
  EXPECT_THAT(HttpListener::Start(listener_->address(), handler),
              StatusIs(StatusCode::kUnavailable, "cannot listen on http://127.0.0.1:"));
  EXPECT_THAT(HttpListener::Start({"a.name", 0}, handler),
              StatusIs(StatusCode::kInvalidArgument, "'a.name' is no IP address"));
}

}  // namespace
}  // namespace shiftmap
