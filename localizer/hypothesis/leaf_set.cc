// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/leaf_set.h"

#include <algorithm>
#include <utility>

namespace shiftmap {

LeafSet::LeafSet(const LeafSet& other) {
  for (const Leaf* leaf : other.active_) Add(*leaf);
}

LeafSet& LeafSet::operator=(const LeafSet& other) {
  if (this != &other) *this = LeafSet(other);
  return *this;
}

void LeafSet::Reserve(std::size_t leaves, std::size_t beliefs, const Leaf& pattern) {
  owned_.reserve(leaves);
  for (std::vector<Leaf*>* list : {&active_, &spare_, &rebuilt_}) list->reserve(leaves);
  while (owned_.size() < leaves) {
    spare_.push_back(owned_.emplace_back(std::make_unique<Leaf>(pattern)).get());
  }
  for (const std::unique_ptr<Leaf>& leaf : owned_) leaf->beliefs.reserve(beliefs);
}

Leaf& LeafSet::Add(const Leaf& leaf) {
  if (spare_.empty()) {
    active_.push_back(owned_.emplace_back(std::make_unique<Leaf>(leaf)).get());
  } else {
    Leaf* const reused = spare_.back();
    spare_.pop_back();
    *reused = leaf;
    active_.push_back(reused);
  }
  return *active_.back();
}

void LeafSet::Clear() {
  spare_.insert(spare_.end(), active_.begin(), active_.end());
  active_.clear();
}

void LeafSet::PopBack() {
  spare_.push_back(active_.back());
  active_.pop_back();
}

void LeafSet::SortByWeight() {
  // Without the buffer that std::stable_sort allocates. Leaves are few and nearly in order.
  const auto lighter = [](const Leaf* a, const Leaf* b) { return a->log_weight < b->log_weight; };
  for (std::size_t i = 1; i < active_.size(); ++i) {
    if (!lighter(active_[i - 1], active_[i])) continue;
    const auto end = active_.begin() + static_cast<std::ptrdiff_t>(i);
    const auto place =
        std::upper_bound(active_.begin(), end, active_[i], [&](const Leaf* a, const Leaf* b) {
          return lighter(b, a);
        });
    std::rotate(place, end, end + 1);
  }
}

std::span<Leaf* const> LeafSet::Rebuild() {
  std::swap(active_, rebuilt_);
  active_.clear();
  return rebuilt_;
}

}  // namespace shiftmap
