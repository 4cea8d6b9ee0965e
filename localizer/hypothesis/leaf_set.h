// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "localizer/hypothesis/leaf.h"

namespace shiftmap {

/// An ordered set of leaves that reuses the memory of those that went: a leaf has some ten
/// kilobytes, and steps fork and drop dozens of them.
///
/// Ownership: of the leaves; pointers to a leaf are valid until it goes. A copy has leaves of its
/// own and none in reserve. Threads: none.
class LeafSet {
 public:
  LeafSet() = default;
  LeafSet(const LeafSet& other);
  LeafSet& operator=(const LeafSet& other);
  LeafSet(LeafSet&&) = default;
  LeafSet& operator=(LeafSet&&) = default;
  ~LeafSet() = default;

  std::size_t size() const { return active_.size(); }
  bool empty() const { return active_.empty(); }
  Leaf& front() { return *active_.front(); }
  const Leaf& front() const { return *active_.front(); }
  const Leaf& back() const { return *active_.back(); }
  const Leaf& operator[](std::size_t i) const { return *active_[i]; }
  std::span<Leaf* const> all() { return active_; }
  std::span<const Leaf* const> all() const { return {active_.data(), active_.size()}; }

  /// Makes memory for `leaves` leaves in all, with room for `beliefs` beliefs each.
  void Reserve(std::size_t leaves, std::size_t beliefs, const Leaf& pattern);

  /// Appends a copy.
  Leaf& Add(const Leaf& leaf);

  void Clear();
  void PopBack();

  /// Heaviest first; leaves of equal weight keep their order.
  void SortByWeight();

  /// Takes all leaves out, in order. Each of them has then to be put back by Keep() or let go by
  /// Drop(); Add() may come between. Valid until the next Rebuild().
  std::span<Leaf* const> Rebuild();
  void Keep(Leaf* leaf) { active_.push_back(leaf); }
  void Drop(Leaf* leaf) { spare_.push_back(leaf); }

 private:
  std::vector<std::unique_ptr<Leaf>> owned_;
  std::vector<Leaf*> active_;   // In order.
  std::vector<Leaf*> spare_;    // In reserve.
  std::vector<Leaf*> rebuilt_;  // Those that Rebuild() took out.
};

}  // namespace shiftmap
