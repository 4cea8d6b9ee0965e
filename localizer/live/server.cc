// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/server.h"

#include <poll.h>
#include <sys/signalfd.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <iterator>
#include <utility>

#include "localizer/live/client_places.h"
#include "localizer/live/codec/live_codec.h"
#include "localizer/live/unix_socket.h"
#include "mapstore/core/blocked_signals.h"

namespace shiftmap::live {
namespace {

constexpr std::chrono::milliseconds kSyncEvery(1000);
constexpr std::chrono::milliseconds kLookForPlaceEvery(10);

// Share of one client in a turn; its last message may take longer.
constexpr std::chrono::milliseconds kShareOfTurn(2);

StatusOr<OwnedFd> TakeOverSignals() {
  const sigset_t stopping = EndingSignals();
  sigprocmask(SIG_BLOCK, &stopping, nullptr);
  OwnedFd fd(signalfd(-1, &stopping, SFD_CLOEXEC | SFD_NONBLOCK));
  if (fd.get() < 0) return Unavailable("signals: cannot wait for them: {}", std::strerror(errno));
  return fd;
}

// What a client could take at once, with its length before it.
constexpr std::size_t kMaxEventBytes = Connection::kMaxQueuedBytes - 4;
static_assert(kMaxEventBytes <= kMaxFrameBytes);

// What does not fit is replaced by a reply that says so, or left out if it is no reply.
std::string FramedEvent(const Event& event) {
  const std::string message = EncodeEvent(event);
  if (message.size() <= kMaxEventBytes) return Framed(message);
  const auto* reply = std::get_if<Reply>(&event);
  if (reply == nullptr) return "";
  const Status status = MakeStatus(StatusCode::kResourceExhausted,
                                   "reply of {} bytes, expected at most {}",
                                   message.size(),
                                   kMaxEventBytes);
  return Framed(EncodeEvent(Reply{reply->id, status, std::nullopt}));
}

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
    StepCallback();
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
  std::vector<pollfd> waiting = {
      {.fd = signals_.get(), .events = POLLIN, .revents = 0},
      {.fd = listener_.get(), .events = static_cast<short>(full_ ? 0 : POLLIN), .revents = 0}};
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
    if ((revents & (POLLIN | POLLHUP | POLLERR)) != 0 || client.has_more()) Serve(&client);
  }
  if (waiting[1].revents != 0 || full_) Accept();
  return OkStatus();
}

std::chrono::milliseconds Server::LongestWait() const {
  auto longest = std::min(kSyncEvery, notifier_->interval().value_or(kSyncEvery));
  if (full_) longest = std::min(longest, kLookForPlaceEvery);
  if (std::any_of(clients_.begin(), clients_.end(), [](const Connection& client) {
        return client.has_more();
      })) {
    longest = std::chrono::milliseconds(0);
  }
  const auto held_until = service_->held_until();
  if (!held_until) return longest;
  const auto left =
      std::chrono::ceil<std::chrono::milliseconds>(*held_until - std::chrono::steady_clock::now());
  return std::clamp(left, std::chrono::milliseconds(0), longest);
}

void Server::LocalizeHeld() {
  events_.clear();
  service_->LocalizeHeld(std::chrono::steady_clock::now(), &events_);
  SendEvents();
}

void Server::StepCallback() {
  events_.clear();
  service_->StepCallback(&events_);
  SendEvents();
}

bool Server::MakePlace() {
  if (clients_.size() < kMaxKeptClients + kGuestPlaces) return true;
  std::vector<ClientActivity> activities;
  for (const Connection& client : clients_) activities.push_back(client.activity());
  const auto closed = GuestToClose(activities, std::chrono::steady_clock::now());
  if (!closed) return false;
  clients_.erase(std::next(clients_.begin(), static_cast<std::ptrdiff_t>(*closed)));
  service_->CountDropped("client");
  return true;
}

// A client that finds no place waits in the queue of the socket until a guest's grace is over.
void Server::Accept() {
  full_ = !MakePlace();
  if (full_) return;
  OwnedFd fd(accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
  if (fd.get() < 0) return;
  clients_.emplace_back(std::move(fd), std::chrono::steady_clock::now());
}

void Server::Keep(Connection* client) {
  const auto kept = std::count_if(clients_.begin(), clients_.end(), [](const Connection& other) {
    return other.activity().kept;
  });
  if (static_cast<std::size_t>(kept) < kMaxKeptClients) client->Keep();
}

void Server::Serve(Connection* client) {
  const auto begin = std::chrono::steady_clock::now();
  if (client->wants_read()) client->Read();
  for (auto now = begin; now < begin + kShareOfTurn && !client->Done();
       now = std::chrono::steady_clock::now()) {
    const auto message = client->NextMessage(now);
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
  auto request = DecodeRequest(message, &id);
  if (!request.ok()) {
    service_->CountDropped("bad_request");
    if (id != 0) client->SendReply(FramedEvent(Reply{id, request.status(), std::nullopt}));
    return;
  }
  const auto* subscribe = std::get_if<Subscribe>(&request->command);
  if (subscribe != nullptr) {
    if (const Status status = TakeSubscription(*subscribe, client); !status.ok()) {
      if (id != 0) client->SendReply(FramedEvent(Reply{id, status, std::nullopt}));
      return;
    }
  }
  request->from_map_owner = client->subscription().map_owner;
  if ((Feeds(request->command) || subscribe != nullptr) && !client->activity().kept) Keep(client);
  NoteDownloader();
  events_.clear();
  const Reply reply = service_->Handle(*request, &events_);
  if (id != 0) client->SendReply(FramedEvent(reply));
  SendEvents();
}

Status Server::TakeSubscription(const Subscribe& subscription, Connection* client) {
  if (subscription.map_owner && !service_->has_map_owner()) {
    return FailedPrecondition(
        "requests change maps here (map_source = vda5050), expected no owner of maps");
  }
  const bool taken = std::any_of(clients_.begin(), clients_.end(), [&](const Connection& other) {
    return &other != client && other.subscription().map_downloads;
  });
  if (subscription.map_downloads && taken) {
    return FailedPrecondition("another client downloads maps already");
  }
  client->set_subscription(subscription);
  return OkStatus();
}

// Downloads that wait for a client that is gone have failed.
void Server::NoteDownloader() {
  const bool present = std::any_of(clients_.begin(), clients_.end(), [](const Connection& client) {
    return client.subscription().map_downloads;
  });
  if (present != std::exchange(downloader_, present)) service_->SetDownloader(present);
}

void Server::SendEvents() {
  for (const Event& event : events_) {
    const std::string frame = FramedEvent(event);
    if (frame.empty()) continue;
    for (Connection& other : clients_) other.SendEvents(event, frame);
  }
}

void Server::FlushAll() {
  const auto now = std::chrono::steady_clock::now();
  for (auto client = clients_.begin(); client != clients_.end();) {
    client->Flush();
    service_->CountDropped("slow_client", client->TakeDropped());
    const bool expired = HasExpired(client->activity(), now);
    if (expired) service_->CountDropped("client");
    if (client->Done() || expired) {
      client = clients_.erase(client);
    } else {
      ++client;
    }
  }
  NoteDownloader();
}

}  // namespace shiftmap::live
