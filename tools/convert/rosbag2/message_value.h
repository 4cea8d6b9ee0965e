// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "mapstore/core/stamp.h"
#include "proto/core/status.h"
#include "tools/convert/rosbag2/message_definition.h"

namespace shiftmap::rosbag2 {

/// A value of a decoded message: a number, a text, an array or a message.
///
/// Fields are named by their path, `pose.pose.position.x`. Errors, of every function:
/// kInvalidArgument with the path if there is no such field, or it holds something else.
///
/// Ownership: a message refers to its definition, which must outlive it.
class MessageValue {
 public:
  struct Fields {
    const MessageType* type = nullptr;
    std::vector<MessageValue> values;  ///< As many as the type has.
  };
  /// Whole numbers up to 64 bits keep their value; `string` may be bytes too.
  using Content = std::variant<std::int64_t,
                               std::uint64_t,
                               double,
                               std::string,
                               std::vector<double>,
                               std::vector<MessageValue>,
                               Fields>;

  MessageValue() = default;
  explicit MessageValue(Content content) : content_(std::move(content)) {}

  /// The value at a path, or null.
  const MessageValue* Find(std::string_view path) const;

  StatusOr<double> Number(std::string_view path) const;
  StatusOr<std::int64_t> Integer(std::string_view path) const;
  StatusOr<std::string> Text(std::string_view path) const;

  /// The numbers of an array of numbers.
  StatusOr<const std::vector<double>*> Numbers(std::string_view path) const;

  /// The elements of an array of messages or texts.
  StatusOr<const std::vector<MessageValue>*> List(std::string_view path) const;

  /// A time, of seconds and nanoseconds.
  StatusOr<Stamp> Time(std::string_view path) const;

 private:
  template <typename T>
  const T* As(std::string_view path) const;

  Content content_ = std::int64_t{0};
};

}  // namespace shiftmap::rosbag2
