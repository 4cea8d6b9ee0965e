// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/server.h"

#include <poll.h>
#include <sys/signalfd.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>

#include "localizer/live/codec/live_codec.h"
#include "localizer/live/unix_socket.h"

namespace shiftmap::live {
namespace {

constexpr std::chrono::milliseconds kSyncEvery(1000);
constexpr std::size_t kMaxClients = 32;

StatusOr<OwnedFd> TakeOverSignals() {
  sigset_t stopping;
  sigemptyset(&stopping);
  sigaddset(&stopping, SIGTERM);
  sigaddset(&stopping, SIGINT);
  sigprocmask(SIG_BLOCK, &stopping, nullptr);
  OwnedFd fd(signalfd(-1, &stopping, SFD_CLOEXEC | SFD_NONBLOCK));
  if (fd.get() < 0) return Unavailable("signals: cannot wait for them: {}", std::strerror(errno));
  return fd;
}

std::string FramedEvent(const Event& event) { return Framed(EncodeEvent(event)); }

}  // namespace

StatusOr<Server> Server::Listen(const std::string& path, ServiceNotifier* notifier) {
  SHIFTMAP_ASSIGN_OR_RETURN(OwnedFd listener, ListenAt(path));
  return Server(path, std::move(listener), notifier);
}

Server::~Server() {
  if (listener_.get() >= 0) unlink(path_.c_str());
}

Status Server::Run(Service* service) {
  service_ = service;
  SHIFTMAP_ASSIGN_OR_RETURN(signals_, TakeOverSignals());
  next_sync_ = std::chrono::steady_clock::now() + kSyncEvery;
  notifier_->Ready();
  for (bool stop = false; !stop;) {
    SHIFTMAP_RETURN_IF_ERROR(Wait(&stop));
    LocalizeHeld();
    service_->WriteJournal();
    FlushAll();
    if (const auto now = std::chrono::steady_clock::now(); now >= next_sync_) {
      service_->SyncJournal();
      next_sync_ = now + kSyncEvery;
    }
    notifier_->Alive();
  }
  notifier_->Stopping();
  return service_->Shutdown();
}

Status Server::Wait(bool* stop) {
  std::vector<pollfd> waiting = {{.fd = signals_.get(), .events = POLLIN, .revents = 0},
                                 {.fd = listener_.get(), .events = POLLIN, .revents = 0}};
  for (const Connection& client : clients_) {
    const int events = (client.wants_read() ? POLLIN : 0) | (client.wants_write() ? POLLOUT : 0);
    waiting.push_back({.fd = client.fd(), .events = static_cast<short>(events), .revents = 0});
  }
  if (poll(waiting.data(), waiting.size(), static_cast<int>(LongestWait().count())) < 0) {
    if (errno == EINTR) return OkStatus();
    return Unavailable("poll: {}", std::strerror(errno));
  }
  *stop = waiting[0].revents != 0;
  // Clients first: accepting changes the list.
  auto entry = waiting.begin() + 2;
  for (Connection& client : clients_) {
    const short revents = (entry++)->revents;
    if ((revents & (POLLIN | POLLHUP | POLLERR)) != 0) Serve(&client);
  }
  if (waiting[1].revents != 0) Accept();
  return OkStatus();
}

std::chrono::milliseconds Server::LongestWait() const {
  const auto longest = std::min(kSyncEvery, notifier_->interval().value_or(kSyncEvery));
  const auto held_until = service_->held_until();
  if (!held_until) return longest;
  const auto left =
      std::chrono::ceil<std::chrono::milliseconds>(*held_until - std::chrono::steady_clock::now());
  return std::clamp(left, std::chrono::milliseconds(0), longest);
}

void Server::LocalizeHeld() {
  events_.clear();
  service_->LocalizeHeld(std::chrono::steady_clock::now(), &events_);
  SendNews();
}

void Server::Accept() {
  OwnedFd fd(accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
  if (fd.get() < 0) return;
  if (clients_.size() >= kMaxClients) {
    service_->CountDropped("client");
    return;
  }
  clients_.emplace_back(std::move(fd));
}

void Server::Serve(Connection* client) {
  client->Read();
  for (;;) {
    const auto message = client->NextMessage();
    if (!message.ok()) {
      service_->CountDropped("bad_frame");
      client->SendReply(FramedEvent(Reply{0, message.status(), std::nullopt}));
      return;
    }
    if (!message->has_value()) return;
    Answer(client, **message);
  }
}

void Server::Answer(Connection* client, const std::string& message) {
  std::uint64_t id = 0;
  const auto request = DecodeRequest(message, &id);
  if (!request.ok()) {
    service_->CountDropped("bad_request");
    if (id != 0) client->SendReply(FramedEvent(Reply{id, request.status(), std::nullopt}));
    return;
  }
  if (const auto* subscribe = std::get_if<Subscribe>(&request->command)) {
    client->set_subscription(*subscribe);
  }
  events_.clear();
  const Reply reply = service_->Handle(*request, &events_);
  if (id != 0) client->SendReply(FramedEvent(reply));
  SendNews();
}

void Server::SendNews() {
  for (const Event& event : events_) {
    const std::string frame = FramedEvent(event);
    for (Connection& other : clients_) other.SendNews(event, frame);
  }
}

void Server::FlushAll() {
  for (auto client = clients_.begin(); client != clients_.end();) {
    client->Flush();
    service_->CountDropped("slow_client", client->TakeDropped());
    if (client->Done()) {
      client = clients_.erase(client);
    } else {
      ++client;
    }
  }
}

}  // namespace shiftmap::live
