// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/message_value.h"

#include <limits>

namespace shiftmap::rosbag2 {
namespace {

Status NoSuch(std::string_view kind, std::string_view path) {
  return InvalidArgument("field '{}': expected a {}", path, kind);
}

}  // namespace

const MessageValue* MessageValue::Find(std::string_view path) const {
  const MessageValue* value = this;
  while (!path.empty()) {
    const std::size_t dot = path.find('.');
    const std::string_view name = path.substr(0, dot);
    path = dot == std::string_view::npos ? std::string_view() : path.substr(dot + 1);
    const auto* message = std::get_if<Fields>(&value->content_);
    if (message == nullptr) return nullptr;
    const std::vector<MessageField>& fields = message->type->fields;
    std::size_t index = 0;
    while (index < fields.size() && fields[index].name != name) ++index;
    if (index == fields.size()) return nullptr;
    value = &message->values[index];
  }
  return value;
}

template <typename T>
const T* MessageValue::As(std::string_view path) const {
  const MessageValue* value = Find(path);
  return value == nullptr ? nullptr : std::get_if<T>(&value->content_);
}

StatusOr<double> MessageValue::Number(std::string_view path) const {
  if (const auto* value = As<double>(path)) return *value;
  if (const auto* value = As<std::int64_t>(path)) return static_cast<double>(*value);
  if (const auto* value = As<std::uint64_t>(path)) return static_cast<double>(*value);
  return NoSuch("number", path);
}

StatusOr<std::int64_t> MessageValue::Integer(std::string_view path) const {
  if (const auto* value = As<std::int64_t>(path)) return *value;
  const auto* value = As<std::uint64_t>(path);
  if (value != nullptr && *value <= std::numeric_limits<std::int64_t>::max()) {
    return static_cast<std::int64_t>(*value);
  }
  return NoSuch("whole number", path);
}

StatusOr<std::string> MessageValue::Text(std::string_view path) const {
  if (const auto* value = As<std::string>(path)) return *value;
  return NoSuch("text", path);
}

StatusOr<const std::vector<double>*> MessageValue::Numbers(std::string_view path) const {
  if (const auto* value = As<std::vector<double>>(path)) return value;
  return NoSuch("array of numbers", path);
}

StatusOr<const std::vector<MessageValue>*> MessageValue::List(std::string_view path) const {
  if (const auto* value = As<std::vector<MessageValue>>(path)) return value;
  return NoSuch("array of messages", path);
}

StatusOr<Stamp> MessageValue::Time(std::string_view path) const {
  constexpr std::int64_t kNanoseconds = 1'000'000'000;
  const std::string prefix = std::string(path) + ".";
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t seconds, Integer(prefix + "sec"));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t rest, Integer(prefix + "nanosec"));
  if (rest < 0 || rest >= kNanoseconds ||
      seconds != std::int64_t{static_cast<std::int32_t>(seconds)}) {
    return InvalidArgument("field '{}': {} s and {} ns, expected a time", path, seconds, rest);
  }
  return StampFromNanoseconds(seconds * kNanoseconds + rest);
}

}  // namespace shiftmap::rosbag2
