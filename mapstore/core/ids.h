// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>

namespace shiftmap {

/// The identity that perception reads off a landmark, e.g. a barcode in decimal. Unique per
/// physical landmark within an area; empty for an anonymous landmark. Compares as bytes.
class Signature {
 public:
  Signature() = default;
  explicit Signature(std::string text) : text_(std::move(text)) {}

  const std::string& text() const { return text_; }
  bool anonymous() const { return text_.empty(); }

  friend auto operator<=>(const Signature&, const Signature&) = default;
  friend bool operator==(const Signature&, const Signature&) = default;

 private:
  std::string text_;
};

/// An integer that cannot be mixed up with another kind of integer.
template <typename Tag>
class Id {
 public:
  using Value = std::int64_t;

  constexpr Id() = default;
  constexpr explicit Id(Value value) : value_(value) {}

  constexpr Value value() const { return value_; }

  friend constexpr auto operator<=>(Id, Id) = default;

 private:
  Value value_ = 0;
};

/// Names a mode within its landmark group, stable along a chain of map versions and never reused:
/// (area, signature, mode number) is the identity of a mode. Regular modes count from 1.
using ModeNumber = Id<struct ModeNumberTag>;

/// The mode `absent`: the alternative hypothesis H0, T-IV (21), the landmark is at no known
/// position.
inline constexpr ModeNumber kAbsent{0};

/// Numbers the versions of one area, from 1.
using VersionNumber = Id<struct VersionNumberTag>;

/// How far a reader saw the ledger of a store: it grows with every report that is returned.
using LedgerPosition = Id<struct LedgerPositionTag>;

}  // namespace shiftmap

template <>
struct std::hash<shiftmap::Signature> {
  std::size_t operator()(const shiftmap::Signature& signature) const noexcept {
    return std::hash<std::string>()(signature.text());
  }
};

template <typename Tag>
struct std::hash<shiftmap::Id<Tag>> {
  std::size_t operator()(shiftmap::Id<Tag> id) const noexcept {
    return std::hash<typename shiftmap::Id<Tag>::Value>()(id.value());
  }
};
