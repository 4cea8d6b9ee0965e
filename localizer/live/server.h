// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <list>
#include <string>
#include <vector>

#include "localizer/live/connection.h"
#include "localizer/live/service.h"
#include "mapstore/core/owned_fd.h"
#include "mapstore/core/service_notifier.h"
#include "proto/core/status.h"

namespace shiftmap::live {

/// Serves clients on a Unix socket, one thread, until SIGTERM or SIGINT.
///
/// One turn: wait, take in requests, step (also when the stream pauses), write the journal, then
/// send replies and events. So a reply to a step is sent after the journal has it, and neither disk
/// nor a client is waited for inside a step. Each client has some milliseconds of a turn, so that
/// one that floods delays the others by little. client_places.h says who may stay connected.
class Server {
 public:
  /// Clients can connect from here on; they are answered by Run().
  /// @param notifier  Outlives this.
  /// Errors: as ListenAt.
  static StatusOr<Server> Listen(const std::string& path, ServiceNotifier* notifier);

  Server(Server&&) noexcept = default;
  Server& operator=(Server&&) = delete;

  /// Removes the socket file.
  ~Server();

  /// Takes over SIGTERM and SIGINT, serves until one of them comes, then ends the shift.
  /// @param service  Outlives this.
  /// Errors: as Service::Shutdown; kUnavailable if the system refuses to wait.
  Status Run(Service* service);

 private:
  Server(std::string path, OwnedFd listener, ServiceNotifier* notifier)
      : path_(std::move(path)), listener_(std::move(listener)), notifier_(notifier) {}

  Status Wait(bool* stop);
  bool MakePlace();
  void Accept();
  void Keep(Connection* client);
  void Serve(Connection* client);
  void Answer(Connection* client, const std::string& message);
  std::chrono::milliseconds LongestWait() const;
  void LocalizeHeld();
  void StepCallback();
  Status TakeSubscription(const Subscribe& subscription, Connection* client);
  void NoteDownloader();
  void SendEvents();
  void FlushAll();

  std::string path_;
  OwnedFd listener_;
  OwnedFd signals_;
  Service* service_ = nullptr;
  ServiceNotifier* notifier_;
  bool full_ = false;        // A client waits for a place.
  bool downloader_ = false;  // One that downloads maps is connected.
  std::list<Connection> clients_;
  std::vector<Event> events_;
  std::chrono::steady_clock::time_point next_sync_;
};

}  // namespace shiftmap::live
