// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace shiftmap {

/// An ordered set of leaves that reuses the memory of those that went: a leaf has some ten
/// kilobytes, and steps fork and drop dozens of them.
///
/// Ownership: of the leaves; pointers to a leaf are valid until it goes. A copy has leaves of its
/// own and none in reserve. Threads: none.
template <class LeafType>
class LeafSet {
 public:
  LeafSet() = default;
  LeafSet(const LeafSet& other);
  LeafSet& operator=(const LeafSet& other);
  LeafSet(LeafSet&&) noexcept = default;
  LeafSet& operator=(LeafSet&&) noexcept = default;
  ~LeafSet() = default;

  std::size_t size() const { return active_.size(); }
  /// Leaves that there is memory for.
  std::size_t owned() const { return owned_.size(); }
  bool empty() const { return active_.empty(); }
  LeafType& front() { return *active_.front(); }
  const LeafType& front() const { return *active_.front(); }
  const LeafType& back() const { return *active_.back(); }
  const LeafType& operator[](std::size_t i) const { return *active_[i]; }
  std::span<LeafType* const> all() { return active_; }
  std::span<const LeafType* const> all() const { return {active_.data(), active_.size()}; }

  /// Makes memory for `leaves` leaves in all, with room for `beliefs` beliefs each.
  void Reserve(std::size_t leaves, std::size_t beliefs, const LeafType& pattern);

  /// Appends a copy.
  LeafType& Add(const LeafType& leaf);

  void Clear();
  void PopBack();

  /// Heaviest first; leaves of equal weight keep their order.
  void SortByWeight();

  /// Takes all leaves out, in order. Each of them has then to be put back by Keep() or let go by
  /// Drop(); Add() may come between. Valid until the next Rebuild().
  std::span<LeafType* const> Rebuild();
  void Keep(LeafType* leaf) { active_.push_back(leaf); }
  void Drop(LeafType* leaf) { spare_.push_back(leaf); }

 private:
  std::vector<std::unique_ptr<LeafType>> owned_;
  std::vector<LeafType*> active_;   // In order.
  std::vector<LeafType*> spare_;    // In reserve.
  std::vector<LeafType*> rebuilt_;  // Those that Rebuild() took out.
};

template <class LeafType>
LeafSet<LeafType>::LeafSet(const LeafSet& other) {
  for (const LeafType* leaf : other.active_) Add(*leaf);
}

template <class LeafType>
LeafSet<LeafType>& LeafSet<LeafType>::operator=(const LeafSet& other) {
  if (this != &other) *this = LeafSet(other);
  return *this;
}

template <class LeafType>
void LeafSet<LeafType>::Reserve(std::size_t leaves, std::size_t beliefs, const LeafType& pattern) {
  owned_.reserve(leaves);
  for (std::vector<LeafType*>* list : {&active_, &spare_, &rebuilt_}) list->reserve(leaves);
  while (owned_.size() < leaves) {
    spare_.push_back(owned_.emplace_back(std::make_unique<LeafType>(pattern)).get());
  }
  for (const std::unique_ptr<LeafType>& leaf : owned_) leaf->beliefs.reserve(beliefs);
}

template <class LeafType>
LeafType& LeafSet<LeafType>::Add(const LeafType& leaf) {
  if (spare_.empty()) {
    active_.push_back(owned_.emplace_back(std::make_unique<LeafType>(leaf)).get());
  } else {
    LeafType* const reused = spare_.back();
    spare_.pop_back();
    *reused = leaf;
    active_.push_back(reused);
  }
  return *active_.back();
}

template <class LeafType>
void LeafSet<LeafType>::Clear() {
  spare_.insert(spare_.end(), active_.begin(), active_.end());
  active_.clear();
}

template <class LeafType>
void LeafSet<LeafType>::PopBack() {
  spare_.push_back(active_.back());
  active_.pop_back();
}

template <class LeafType>
void LeafSet<LeafType>::SortByWeight() {
  // Without the buffer that std::stable_sort allocates. Leaves are few and nearly in order.
  const auto lighter = [](const LeafType* a, const LeafType* b) {
    return a->log_weight < b->log_weight;
  };
  for (std::size_t i = 1; i < active_.size(); ++i) {
    if (!lighter(active_[i - 1], active_[i])) continue;
    const auto end = active_.begin() + static_cast<std::ptrdiff_t>(i);
    const auto place = std::upper_bound(
        active_.begin(), end, active_[i], [&](const LeafType* a, const LeafType* b) {
          return lighter(b, a);
        });
    std::rotate(place, end, end + 1);
  }
}

template <class LeafType>
std::span<LeafType* const> LeafSet<LeafType>::Rebuild() {
  std::swap(active_, rebuilt_);
  active_.clear();
  return rebuilt_;
}

}  // namespace shiftmap
