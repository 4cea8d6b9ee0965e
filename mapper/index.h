// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <compare>
#include <concepts>
#include <cstddef>
#include <utility>
#include <vector>

namespace shiftmap {

/// A place in a list, which cannot be mixed up with a place in a list of another kind.
template <typename Tag>
class TypedIndex {
 public:
  constexpr TypedIndex() = default;
  constexpr explicit TypedIndex(int value) : value_(value) {}
  constexpr explicit TypedIndex(std::size_t value) : value_(static_cast<int>(value)) {}
  constexpr explicit TypedIndex(std::ptrdiff_t value) : value_(static_cast<int>(value)) {}

  /// A number that is written out says itself what it is.
  template <std::same_as<int> Constant>
  consteval TypedIndex(Constant value) : value_(value) {}

  constexpr int value() const { return value_; }

  constexpr TypedIndex& operator++() { return ++value_, *this; }
  constexpr TypedIndex operator++(int) { return TypedIndex(value_++); }

  friend constexpr TypedIndex operator+(TypedIndex i, int n) { return TypedIndex(i.value_ + n); }
  friend constexpr TypedIndex operator-(TypedIndex i, int n) { return TypedIndex(i.value_ - n); }
  friend constexpr int operator-(TypedIndex a, TypedIndex b) { return a.value_ - b.value_; }

  /// Where the item begins in a vector that has so many rows of each.
  friend constexpr std::ptrdiff_t operator*(int rows, TypedIndex i) {
    return std::ptrdiff_t{rows} * i.value_;
  }

  friend constexpr auto operator<=>(TypedIndex, TypedIndex) = default;

 private:
  int value_ = 0;
};

/// Indices from `first` on, before `last`.
template <typename Index>
struct IndexRange {
  struct Iterator {
    Index operator*() const { return at; }
    Iterator& operator++() { return ++at, *this; }
    bool operator==(const Iterator&) const = default;

    Index at;
  };
  Iterator begin() const { return {first}; }
  Iterator end() const { return {last}; }

  Index first;
  Index last;
};

/// A list whose items are named by indices of one kind.
template <typename Index, typename T>
class IndexedVector : public std::vector<T> {
 public:
  using std::vector<T>::vector;
  IndexedVector(std::vector<T> items) : std::vector<T>(std::move(items)) {}

  decltype(auto) operator[](Index i) { return std::vector<T>::operator[](Place(i)); }
  decltype(auto) operator[](Index i) const { return std::vector<T>::operator[](Place(i)); }

  /// That of the next item to be added.
  Index end_index() const { return Index(this->size()); }

  /// Of all items, in order.
  IndexRange<Index> indices() const { return {Index(), end_index()}; }

 private:
  static std::size_t Place(Index i) { return static_cast<std::size_t>(i.value()); }
};

using RunIndex = TypedIndex<struct RunTag>;            ///< In Graph::runs, BuildState::runs.
using FrameIndex = TypedIndex<struct FrameTag>;        ///< Of a run's key frame.
using SightingIndex = TypedIndex<struct SightingTag>;  ///< In MappingRun::sightings.
using VisitIndex = TypedIndex<struct VisitTag>;        ///< In MappingRun::visits.
using GroupIndex = TypedIndex<struct GroupTag>;  ///< In the sorted list of a build's signatures.
using GroupModeIndex = TypedIndex<struct GroupModeTag>;      ///< In a group of BuildState::modes.
using ModeIndex = TypedIndex<struct ModeTag>;                ///< In Graph::modes.
using ObservationIndex = TypedIndex<struct ObservationTag>;  ///< In Graph::observations.
using LandmarkIndex = TypedIndex<struct LandmarkTag>;  ///< Of those that two maps have in common.
using MatchIndex = TypedIndex<struct MatchTag>;        ///< In AlignmentEvidence::matches().

}  // namespace shiftmap
