// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/client.h"

#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>

#include "localizer/live/codec/live_codec.h"
#include "localizer/live/unix_socket.h"

namespace shiftmap::live {
namespace {

constexpr std::size_t kReadBytes = std::size_t{16} << 10;

}  // namespace

StatusOr<Client> Client::Connect(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(OwnedFd fd, ConnectTo(path));
  return Client(std::move(fd));
}

Status Client::Send(const Request& request) {
  const std::string message = EncodeRequest(request);
  if (message.size() > kMaxFrameBytes) {
    return InvalidArgument(
        "request of {} bytes, expected at most {}", message.size(), kMaxFrameBytes);
  }
  const std::string frame = Framed(message);
  std::string_view left = frame;
  while (!left.empty()) {
    const ssize_t count = send(fd_.get(), left.data(), left.size(), MSG_NOSIGNAL);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return Unavailable("service is gone: {}", std::strerror(errno));
    left.remove_prefix(static_cast<std::size_t>(count));
  }
  return OkStatus();
}

Status Client::Read() {
  std::array<char, kReadBytes> bytes;
  ssize_t count = 0;
  do {
    count = recv(fd_.get(), bytes.data(), bytes.size(), 0);
  } while (count < 0 && errno == EINTR);
  if (count < 0) return Unavailable("service is gone: {}", std::strerror(errno));
  if (count == 0) return Unavailable("service is gone: it closed the connection");
  reader_.Append(std::string_view(bytes.data(), static_cast<std::size_t>(count)));
  return OkStatus();
}

StatusOr<Event> Client::Receive() {
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<std::string> message, reader_.Next());
    if (message) return DecodeEvent(*message);
    SHIFTMAP_RETURN_IF_ERROR(Read());
  }
}

StatusOr<std::optional<Event>> Client::ReceiveWithin(double seconds) {
  using Clock = std::chrono::steady_clock;
  const auto until = Clock::now() + FromSeconds(seconds);
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<std::string> message, reader_.Next());
    if (message) {
      SHIFTMAP_ASSIGN_OR_RETURN(Event event, DecodeEvent(*message));
      return std::optional<Event>(std::move(event));
    }
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - Clock::now());
    if (left.count() < 0) return std::optional<Event>();
    pollfd waiting = {.fd = fd_.get(), .events = POLLIN, .revents = 0};
    if (poll(&waiting, 1, static_cast<int>(left.count())) > 0) SHIFTMAP_RETURN_IF_ERROR(Read());
  }
}

StatusOr<Reply> Client::Call(const Command& command) {
  const std::uint64_t id = ++last_id_;
  SHIFTMAP_RETURN_IF_ERROR(Send({id, command}));
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const Event event, Receive());
    const auto* reply = std::get_if<Reply>(&event);
    if (reply == nullptr || (reply->id != id && reply->id != 0)) continue;
    if (!reply->status.ok()) return reply->status;
    return *reply;
  }
}

}  // namespace shiftmap::live
