// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <vector>

namespace shiftmap::live {

/// Rules of who may stay connected. A client that feeds items or subscribed is kept, a well-behaved
/// driver and a silent listener alike. The others are guests, such as one `ctl` command: when all
/// places are taken, the guest that was silent longest makes room for the next.
struct ClientOptions {
  std::size_t max_kept = 32;  ///< Kept at most; one more is a guest. > 0.
  std::size_t guests = 8;     ///< Places beyond those, which only guests have. > 0.

  /// A guest has at least this long to say its first message, and to take a reply, > 0. [s]
  double grace_s = 0.2;

  /// Clients are closed that have not said a first message, that have sent a part of one, and
  /// guests that have been silent, for longer than this. > 0. [s]
  double max_first_message_s = 10.0;
  double max_half_message_s = 5.0;
  double max_silent_guest_s = 300.0;
};

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
bool HasExpired(const ClientActivity& client,
                const ClientOptions& options,
                ClientActivity::Clock::time_point now);

/// Index of the guest to close when all places are taken and another client comes; nothing if all
/// are kept or in their grace.
std::optional<std::size_t> GuestToClose(const std::vector<ClientActivity>& clients,
                                        const ClientOptions& options,
                                        ClientActivity::Clock::time_point now);

}  // namespace shiftmap::live
