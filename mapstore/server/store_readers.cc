// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/store_readers.h"

#include <optional>
#include <utility>

namespace shiftmap::server {

StoreReaders::StoreReaders(Opener open, int count) : open_(std::move(open)), left_(count) {
  idle_.reserve(static_cast<std::size_t>(count));
}

Status StoreReaders::Read(const std::function<Status(MapStore&)>& read) {
  // Gives the reader back, whatever happens.
  struct Loan {
    StoreReaders* owner;
    std::optional<MapStore> store;
    ~Loan() {
      {
        const std::lock_guard lock(owner->mutex_);
        ++owner->left_;
        if (store) owner->idle_.push_back(*std::move(store));
      }
      owner->changed_.notify_one();
    }
  };
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return left_ > 0; });
  --left_;
  Loan loan{this, std::nullopt};
  if (!idle_.empty()) {
    loan.store.emplace(std::move(idle_.back()));
    idle_.pop_back();
  }
  lock.unlock();
  if (!loan.store) {
    SHIFTMAP_ASSIGN_OR_RETURN(MapStore opened, open_());
    loan.store.emplace(std::move(opened));
  }
  return read(*loan.store);
}

}  // namespace shiftmap::server
