// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/client_places.h"

namespace shiftmap::live {
namespace {

// A guest has at least this long to say its first message, and to take a reply. [s]
constexpr double kGraceS = 0.2;

// Clients are closed that have not said a first message, that have sent a part of one, and guests
// that have been silent, for longer than this. [s]
constexpr double kMaxFirstMessageS = 10.0;
constexpr double kMaxHalfMessageS = 5.0;
constexpr double kMaxSilentGuestS = 300.0;

double SecondsSince(ClientActivity::Clock::time_point then, ClientActivity::Clock::time_point now) {
  return std::chrono::duration<double>(now - then).count();
}

}  // namespace

bool HasExpired(const ClientActivity& client, ClientActivity::Clock::time_point now) {
  if (client.half_since && SecondsSince(*client.half_since, now) > kMaxHalfMessageS) {
    return true;
  }
  if (client.kept) return false;
  return SecondsSince(client.last, now) >
         (client.has_spoken ? kMaxSilentGuestS : kMaxFirstMessageS);
}

std::optional<std::size_t> GuestToClose(const std::vector<ClientActivity>& clients,
                                        ClientActivity::Clock::time_point now) {
  std::optional<std::size_t> longest;
  for (std::size_t i = 0; i < clients.size(); ++i) {
    const ClientActivity& client = clients[i];
    const bool in_grace =
        (!client.has_spoken || client.is_owed) && SecondsSince(client.last, now) < kGraceS;
    if (client.kept || in_grace) continue;
    if (!longest || client.last < clients[*longest].last) longest = i;
  }
  return longest;
}

}  // namespace shiftmap::live
