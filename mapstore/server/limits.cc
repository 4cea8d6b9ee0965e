// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/limits.h"

#include <algorithm>

namespace shiftmap::server {
namespace {

constexpr double kBurstS = 2.0;

// Clients above which those that are silent are forgotten.
constexpr std::size_t kMostBuckets = 4096;

}  // namespace

double RateLimit::Filled(const Bucket& bucket, Clock::time_point now) const {
  const double since_s = std::chrono::duration<double>(now - bucket.filled).count();
  const double most = std::max(1.0, kBurstS * per_s_);
  return std::min(most, bucket.tokens + per_s_ * since_s);
}

Status RateLimit::Take(const std::string& client, Clock::time_point now) {
  const double most = std::max(1.0, kBurstS * per_s_);
  const std::lock_guard lock(mutex_);
  if (buckets_.size() >= kMostBuckets && !buckets_.contains(client)) {
    std::erase_if(buckets_, [&](const auto& each) { return Filled(each.second, now) >= most; });
  }
  Bucket& bucket = buckets_.try_emplace(client, Bucket{most, now}).first->second;
  bucket = {Filled(bucket, now), now};
  if (bucket.tokens < 1.0) {
    return MakeStatus(StatusCode::kResourceExhausted, "more than {} calls a second", per_s_);
  }
  bucket.tokens -= 1.0;
  return OkStatus();
}

StatusOr<Slots::Slot> Slots::Take(const std::string& client) {
  const std::lock_guard lock(mutex_);
  if (taken_ >= in_all_) {
    return MakeStatus(StatusCode::kResourceExhausted, "{} streams are open already", taken_);
  }
  int& mine = by_client_[client];
  if (mine >= per_client_) {
    return MakeStatus(
        StatusCode::kResourceExhausted, "{} streams of this client are open already", mine);
  }
  ++mine;
  ++taken_;
  return Slot(this, client);
}

Slots::Slot::~Slot() {
  if (owner_ == nullptr) return;
  const std::lock_guard lock(owner_->mutex_);
  --owner_->taken_;
  const auto mine = owner_->by_client_.find(client_);
  if (--mine->second == 0) owner_->by_client_.erase(mine);
}

int Slots::taken() const {
  const std::lock_guard lock(mutex_);
  return taken_;
}

}  // namespace shiftmap::server
