// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <map>
#include <mutex>
#include <string>
#include <utility>

#include "proto/core/status.h"

namespace shiftmap::server {

/// Calls per second of each client, as a bucket of tokens that holds two seconds' worth.
/// Threads: any.
class RateLimit {
 public:
  using Clock = std::chrono::steady_clock;

  /// @param per_s  Above 0. [1/s]
  explicit RateLimit(double per_s) : per_s_(per_s) {}

  /// Errors: kResourceExhausted if the client calls too often.
  Status Take(const std::string& client, Clock::time_point now = Clock::now());

 private:
  struct Bucket {
    double tokens = 0.0;
    Clock::time_point filled;
  };

  double Filled(const Bucket& bucket, Clock::time_point now) const;

  const double per_s_;
  std::mutex mutex_;
  std::map<std::string, Bucket> buckets_;
};

/// How many of something are under way, in all and of each client. Threads: any.
class Slots {
 public:
  Slots(int in_all, int per_client) : in_all_(in_all), per_client_(per_client) {}

  /// One that is taken, until the end of the object, which must not outlive the Slots.
  class Slot {
   public:
    Slot() = default;
    Slot(Slot&& other) noexcept { *this = std::move(other); }
    Slot& operator=(Slot&& other) noexcept {
      std::swap(owner_, other.owner_);
      std::swap(client_, other.client_);
      return *this;
    }
    ~Slot();

   private:
    friend class Slots;
    Slot(Slots* owner, std::string client) : owner_(owner), client_(std::move(client)) {}
    Slots* owner_ = nullptr;
    std::string client_;
  };

  /// Errors: kResourceExhausted.
  StatusOr<Slot> Take(const std::string& client);

  int taken() const;

 private:
  const int in_all_;
  const int per_client_;
  mutable std::mutex mutex_;
  int taken_ = 0;
  std::map<std::string, int> by_client_;
};

}  // namespace shiftmap::server
