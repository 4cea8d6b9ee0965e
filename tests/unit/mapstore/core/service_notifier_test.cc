// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/service_notifier.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <array>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <thread>

#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

class ServiceNotifierTest : public ::testing::Test {
 protected:
  ~ServiceNotifierTest() override {
    unsetenv("NOTIFY_SOCKET");
    unsetenv("WATCHDOG_USEC");
    unsetenv("WATCHDOG_PID");
  }

  // A service manager at `name`, as $NOTIFY_SOCKET gives it.
  void Listen(const std::string& name) {
    manager_ = OwnedFd(socket(AF_UNIX, SOCK_DGRAM, 0));
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, name.data(), name.size());
    if (name[0] == '@') address.sun_path[0] = '\0';
    const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
    ASSERT_EQ(bind(manager_.get(), reinterpret_cast<const sockaddr*>(&address), length), 0);
    setenv("NOTIFY_SOCKET", name.c_str(), 1);
  }

  std::string Heard() const {
    std::array<char, 256> bytes;
    const ssize_t count = recv(manager_.get(), bytes.data(), bytes.size(), MSG_DONTWAIT);
    return count < 0 ? "" : std::string(bytes.data(), static_cast<std::size_t>(count));
  }

  OwnedFd manager_;
  testing::TempDir folder_;
};

TEST_F(ServiceNotifierTest, SaysItByPathAndByAbstractName) {
  for (const std::string& name : {folder_.File("notify"), "@" + folder_.path() + "/abstract"}) {
    Listen(name);
    ServiceNotifier notifier;
    EXPECT_FALSE(notifier.interval());
    notifier.Alive();
    notifier.Ready();
    notifier.Stopping();
    EXPECT_TRUE(Heard().starts_with("READY=1\n"));
    EXPECT_TRUE(Heard().starts_with("STOPPING=1\n"));
    EXPECT_EQ(Heard(), "");
  }
}

TEST_F(ServiceNotifierTest, AliveAsOftenAsAskedAndNotMore) {
  Listen(folder_.File("notify"));
  setenv("WATCHDOG_USEC", "400000", 1);
  ServiceNotifier notifier;
  EXPECT_EQ(notifier.interval(), std::chrono::milliseconds(200));
  for (int i = 0; i < 1000; ++i) notifier.Alive();
  EXPECT_EQ(Heard(), "WATCHDOG=1");
  EXPECT_EQ(Heard(), "");
  std::this_thread::sleep_for(std::chrono::milliseconds(150));
  notifier.Alive();
  EXPECT_EQ(Heard(), "WATCHDOG=1");
}

TEST_F(ServiceNotifierTest, AnotherProcessWatchdogIsNotOurs) {
  Listen(folder_.File("notify"));
  setenv("WATCHDOG_USEC", "400000", 1);
  setenv("WATCHDOG_PID", "1", 1);
  EXPECT_FALSE(ServiceNotifier().interval());
}

TEST_F(ServiceNotifierTest, NobodyListensIsNoError) {
  ServiceNotifier().Ready();
  setenv("NOTIFY_SOCKET", folder_.File("gone").c_str(), 1);
  ServiceNotifier().Ready();
  setenv("NOTIFY_SOCKET", std::string(500, 'x').c_str(), 1);
  ServiceNotifier().Ready();
}

}  // namespace
}  // namespace shiftmap
