// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/client_places.h"

namespace shiftmap::live {
namespace {

double SecondsSince(ClientActivity::Clock::time_point then, ClientActivity::Clock::time_point now) {
  return std::chrono::duration<double>(now - then).count();
}

}  // namespace

bool HasExpired(const ClientActivity& client,
                const ClientOptions& options,
                ClientActivity::Clock::time_point now) {
  if (client.half_since && SecondsSince(*client.half_since, now) > options.max_half_message_s) {
    return true;
  }
  if (client.kept) return false;
  return SecondsSince(client.last, now) >
         (client.has_spoken ? options.max_silent_guest_s : options.max_first_message_s);
}

std::optional<std::size_t> GuestToClose(const std::vector<ClientActivity>& clients,
                                        const ClientOptions& options,
                                        ClientActivity::Clock::time_point now) {
  std::optional<std::size_t> longest;
  for (std::size_t i = 0; i < clients.size(); ++i) {
    const ClientActivity& client = clients[i];
    const bool in_grace =
        (!client.has_spoken || client.is_owed) && SecondsSince(client.last, now) < options.grace_s;
    if (client.kept || in_grace) continue;
    if (!longest || client.last < clients[*longest].last) longest = i;
  }
  return longest;
}

}  // namespace shiftmap::live
