// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <vector>

namespace shiftmap::live {

/// Who may stay connected. A client that feeds items or subscribed is kept, a well-behaved driver
/// and a silent listener alike. The others are guests, such as one `ctl` command: when all places
/// are taken, the guest that was silent longest makes room for the next.
inline constexpr std::size_t kMaxKeptClients = 32;  ///< One more is a guest.
inline constexpr std::size_t kGuestPlaces = 8;      ///< Beyond those; only guests have them.

/// What a client did so far, by a steady clock.
struct ClientActivity {
  using Clock = std::chrono::steady_clock;

  Clock::time_point last;  ///< Its last whole message, or that it connected.
  bool has_spoken = false;
  bool is_owed = false;  ///< A reply is on its way.
  bool kept = false;
  std::optional<Clock::time_point> half_since =
      std::nullopt;  ///< It has sent a part of a message since.
};

/// True if a client is to be closed, even if there is room for others.
bool HasExpired(const ClientActivity& client, ClientActivity::Clock::time_point now);

/// Index of the guest to close when all places are taken and another client comes; nothing if all
/// are kept or in their grace.
std::optional<std::size_t> GuestToClose(const std::vector<ClientActivity>& clients,
                                        ClientActivity::Clock::time_point now);

}  // namespace shiftmap::live
