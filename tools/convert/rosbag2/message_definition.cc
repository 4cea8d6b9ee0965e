// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/message_definition.h"

#include <charconv>
#include <map>
#include <optional>
#include <utility>

#include "mapstore/core/input_file.h"

namespace shiftmap::rosbag2 {
namespace {

using Kind = MessageField::Kind;

// Far above what a message needs, far below what a hostile text could ask for.
constexpr std::size_t kMaxTextBytes = std::size_t{1} << 20;
constexpr std::size_t kMaxTypes = 1000;
constexpr std::size_t kMaxFields = 20'000;
constexpr std::size_t kMaxFixedCount = 1'000'000;
constexpr int kMaxDepth = 32;

constexpr std::string_view kBlanks = " \t\r";

const std::map<std::string_view, Kind>& Primitives() {
  static const std::map<std::string_view, Kind> kinds = {
      {"bool", Kind::kBool},
      {"byte", Kind::kUint8},
      {"char", Kind::kUint8},
      {"int8", Kind::kInt8},
      {"uint8", Kind::kUint8},
      {"int16", Kind::kInt16},
      {"uint16", Kind::kUint16},
      {"int32", Kind::kInt32},
      {"uint32", Kind::kUint32},
      {"int64", Kind::kInt64},
      {"uint64", Kind::kUint64},
      {"float32", Kind::kFloat32},
      {"float64", Kind::kFloat64},
      {"string", Kind::kString},
  };
  return kinds;
}

// A field whose message type is still a name.
struct NamedField {
  MessageField field;
  std::string type;
};

struct NamedType {
  std::string name;
  std::vector<NamedField> fields;
};

std::string_view Trim(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) + 1 - begin);
}

std::string_view TakeWord(std::string_view* text) {
  const std::size_t end = std::min(text->find_first_of(kBlanks), text->size());
  const std::string_view word = text->substr(0, end);
  *text = Trim(text->substr(end));
  return word;
}

bool IsName(std::string_view text) {
  constexpr std::string_view kAllowed =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_";
  return !text.empty() && text.find_first_not_of(kAllowed) == std::string_view::npos;
}

bool IsTypeName(std::string_view text) {
  for (;;) {
    const std::size_t slash = text.find('/');
    if (!IsName(text.substr(0, slash))) return false;
    if (slash == std::string_view::npos) return true;
    text.remove_prefix(slash + 1);
  }
}

// Takes "[]", "[3]" or "[<=3]" off the end of a type.
Status TakeCount(std::string_view* type, MessageField* field) {
  if (!type->ends_with(']')) return OkStatus();
  const std::size_t open = type->rfind('[');
  if (open == std::string_view::npos) return InvalidArgument("type '{}'", *type);
  const std::string_view inside = type->substr(open + 1, type->size() - open - 2);
  *type = type->substr(0, open);
  field->count = MessageField::Count::kSequence;
  if (inside.empty() || inside.starts_with("<=")) return OkStatus();
  field->count = MessageField::Count::kFixed;
  const char* end = inside.data() + inside.size();
  const auto parsed = std::from_chars(inside.data(), end, field->fixed_count);
  if (parsed.ec != std::errc() || parsed.ptr != end || field->fixed_count == 0 ||
      field->fixed_count > kMaxFixedCount) {
    return InvalidArgument("array of '{}', expected 1 to {}", inside, kMaxFixedCount);
  }
  return OkStatus();
}

// Parses one line of a type; nothing for a constant, a comment or an empty line.
StatusOr<std::optional<NamedField>> ParseLine(std::string_view line, const std::string& package) {
  std::string_view rest = Trim(line.substr(0, line.find('#')));
  if (rest.empty()) return std::nullopt;
  std::string_view type = TakeWord(&rest);
  std::string_view name = TakeWord(&rest);
  const std::size_t equals = name.find('=');
  if (equals != std::string_view::npos || rest.starts_with('=')) return std::nullopt;
  NamedField named;
  SHIFTMAP_RETURN_IF_ERROR(TakeCount(&type, &named.field));
  type = type.substr(0, type.find("<="));  // The bound of a string.
  if (!IsName(name) || !IsTypeName(type)) {
    return InvalidArgument("line '{}', expected a type and a name", Trim(line));
  }
  named.field.name = name;
  if (type == "wstring") return InvalidArgument("field '{}': wstring is not supported", name);
  if (const auto primitive = Primitives().find(type); primitive != Primitives().end()) {
    named.field.kind = primitive->second;
    return named;
  }
  named.field.kind = Kind::kMessage;
  if (type == "time") type = "builtin_interfaces/Time";
  if (type == "duration") type = "builtin_interfaces/Duration";
  if (type == "Header") type = "std_msgs/Header";
  named.type = type.find('/') != std::string_view::npos ? ShortTypeName(type)
                                                        : package + "/" + std::string(type);
  return named;
}

std::string PackageOf(const std::string& type) { return type.substr(0, type.find('/')); }

bool IsSeparator(std::string_view line) {
  return line.size() >= 3 && line.find_first_not_of('=') == std::string_view::npos;
}

StatusOr<std::vector<NamedType>> ParseTypes(std::string_view root, std::string_view text) {
  if (text.size() > kMaxTextBytes) {
    return InvalidArgument("{} bytes, expected at most {}", text.size(), kMaxTextBytes);
  }
  std::vector<NamedType> types = {{ShortTypeName(root), {}}};
  std::size_t fields = 0;
  bool expect_name = false;
  std::string_view line;
  while (TakeLine(&text, &line)) {
    line = Trim(line);
    if (IsSeparator(line)) {
      expect_name = true;
      continue;
    }
    if (expect_name) {
      if (line.empty()) continue;
      constexpr std::string_view kBegin = "MSG:";
      const std::string_view name = Trim(line.substr(std::min(kBegin.size(), line.size())));
      if (!line.starts_with(kBegin) || !IsTypeName(name)) {
        return InvalidArgument("line '{}', expected 'MSG: package/Type'", line);
      }
      types.push_back({ShortTypeName(name), {}});
      if (types.size() > kMaxTypes) return InvalidArgument("more than {} types", kMaxTypes);
      expect_name = false;
      continue;
    }
    SHIFTMAP_ASSIGN_OR_RETURN(auto field, ParseLine(line, PackageOf(types.back().name)));
    if (!field) continue;
    if (++fields > kMaxFields) return InvalidArgument("more than {} fields", kMaxFields);
    types.back().fields.push_back(*std::move(field));
  }
  return types;
}

// Every message knows how a stamp is made.
void AddTimes(std::vector<NamedType>* types) {
  for (const char* name : {"builtin_interfaces/Time", "builtin_interfaces/Duration"}) {
    NamedType type{name, std::vector<NamedField>(2)};
    type.fields[0].field.name = "sec";
    type.fields[0].field.kind = Kind::kInt32;
    type.fields[1].field.name = "nanosec";
    type.fields[1].field.kind = Kind::kUint32;
    types->push_back(std::move(type));
  }
}

// Refuses a type that contains itself, by a depth-first walk.
class CycleCheck {
 public:
  explicit CycleCheck(const std::vector<MessageType>& types)
      : types_(types), states_(types.size(), State::kNew) {}

  Status Visit(std::size_t type, int depth) {
    if (states_[type] == State::kDone) return OkStatus();
    if (states_[type] == State::kOpen) {
      return InvalidArgument("type '{}' contains itself", types_[type].name);
    }
    if (depth > kMaxDepth) return InvalidArgument("nested more than {} deep", kMaxDepth);
    states_[type] = State::kOpen;
    for (const MessageField& field : types_[type].fields) {
      if (field.kind != Kind::kMessage) continue;
      SHIFTMAP_RETURN_IF_ERROR(Visit(field.message, depth + 1));
    }
    states_[type] = State::kDone;
    return OkStatus();
  }

 private:
  enum class State { kNew, kOpen, kDone };
  const std::vector<MessageType>& types_;
  std::vector<State> states_;
};

StatusOr<std::vector<MessageType>> Resolve(std::vector<NamedType> named) {
  std::map<std::string, std::size_t> indices;
  for (std::size_t i = 0; i < named.size(); ++i) indices.emplace(named[i].name, i);
  std::vector<MessageType> types;
  for (NamedType& from : named) {
    MessageType& type = types.emplace_back();
    type.name = std::move(from.name);
    for (NamedField& field : from.fields) {
      if (field.field.kind == Kind::kMessage) {
        const auto found = indices.find(field.type);
        if (found == indices.end()) {
          return InvalidArgument(
              "field '{}': type '{}' is not defined", field.field.name, field.type);
        }
        field.field.message = found->second;
      }
      type.fields.push_back(std::move(field.field));
    }
  }
  SHIFTMAP_RETURN_IF_ERROR(CycleCheck(types).Visit(0, 0));
  return types;
}

}  // namespace

std::string ShortTypeName(std::string_view type) {
  const std::size_t first = type.find('/');
  const std::size_t last = type.rfind('/');
  if (first == std::string_view::npos) return std::string(type);
  return std::string(type.substr(0, first)) + std::string(type.substr(last));
}

StatusOr<MessageDefinition> MessageDefinition::Parse(std::string_view type, std::string_view text) {
  auto named = ParseTypes(type, text);
  if (!named.ok()) return InvalidArgument("definition of {}: {}", type, Message(named.status()));
  AddTimes(&*named);
  auto types = Resolve(*std::move(named));
  if (!types.ok()) return InvalidArgument("definition of {}: {}", type, Message(types.status()));
  MessageDefinition definition;
  definition.types_ = *std::move(types);
  return definition;
}

}  // namespace shiftmap::rosbag2
