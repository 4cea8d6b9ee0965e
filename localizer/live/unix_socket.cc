// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/unix_socket.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include <cerrno>
#include <cstring>

namespace shiftmap::live {
namespace {

constexpr int kBacklog = 64;
constexpr mode_t kAccess = 0660;

Status ErrnoStatus(StatusCode code, const std::string& path, const char* action) {
  return MakeStatus(code, "socket '{}': cannot {}: {}", path, action, std::strerror(errno));
}

StatusOr<sockaddr_un> AddressOf(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::size_t most = sizeof(address.sun_path) - 1;
  if (path.empty() || path.size() > most) {
    return InvalidArgument(
        "socket '{}': path of {} bytes, expected 1..{}", path, path.size(), most);
  }
  std::memcpy(address.sun_path, path.data(), path.size());
  return address;
}

bool Connect(int fd, const sockaddr_un& address) {
  return connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0;
}

StatusOr<OwnedFd> StreamSocket(const std::string& path, int flags) {
  OwnedFd fd(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | flags, 0));
  if (fd.get() < 0) return ErrnoStatus(StatusCode::kUnavailable, path, "make a socket");
  return fd;
}

// Removes a socket file that nobody listens at.
Status RemoveStale(const std::string& path, const sockaddr_un& address) {
  struct stat info {};
  if (lstat(path.c_str(), &info) != 0) return OkStatus();
  if (!S_ISSOCK(info.st_mode)) {
    return InvalidArgument("socket '{}': something other than a socket is there", path);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const OwnedFd probe, StreamSocket(path, SOCK_NONBLOCK));
  if (Connect(probe.get(), address) || errno != ECONNREFUSED) {
    return Unavailable("socket '{}': in use by another process", path);
  }
  if (unlink(path.c_str()) != 0) {
    return ErrnoStatus(StatusCode::kUnavailable, path, "remove the stale one");
  }
  return OkStatus();
}

}  // namespace

StatusOr<OwnedFd> ListenAt(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const sockaddr_un address, AddressOf(path));
  SHIFTMAP_RETURN_IF_ERROR(RemoveStale(path, address));
  SHIFTMAP_ASSIGN_OR_RETURN(OwnedFd fd, StreamSocket(path, SOCK_NONBLOCK));
  if (bind(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) {
    // Another start makes no folder.
    const bool no_folder = errno == ENOENT || errno == ENOTDIR;
    return ErrnoStatus(no_folder ? StatusCode::kNotFound : StatusCode::kUnavailable, path, "bind");
  }
  // Nobody can connect before listen(), so access is never wider than this.
  if (chmod(path.c_str(), kAccess) != 0 || listen(fd.get(), kBacklog) != 0) {
    return ErrnoStatus(StatusCode::kUnavailable, path, "listen");
  }
  return fd;
}

StatusOr<OwnedFd> ConnectTo(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const sockaddr_un address, AddressOf(path));
  SHIFTMAP_ASSIGN_OR_RETURN(OwnedFd fd, StreamSocket(path, 0));
  if (!Connect(fd.get(), address)) return ErrnoStatus(StatusCode::kNotFound, path, "connect");
  return fd;
}

}  // namespace shiftmap::live
