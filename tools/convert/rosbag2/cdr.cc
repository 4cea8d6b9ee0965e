// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/cdr.h"

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastcdr/exceptions/Exception.h>

#include <utility>

namespace shiftmap::rosbag2 {
namespace {

using Kind = MessageField::Kind;
using Count = MessageField::Count;

constexpr std::size_t kMaxMessageBytes = std::size_t{16} << 20;
constexpr std::size_t kEncapsulationBytes = 4;

// Writers fill up to a multiple of a word.
constexpr std::size_t kMaxPaddingBytes = 8;

// The first byte of the encapsulation is 0, the second the byte order.
constexpr unsigned char kBigEndian = 0;
constexpr unsigned char kLittleEndian = 1;

// Decodes one message. Fast-CDR throws at the end of the bytes; Decode() catches.
class Decoder {
 public:
  Decoder(const MessageDefinition& definition, std::string_view bytes)
      : definition_(definition),
        bytes_(bytes),
        // It only reads, but takes a buffer that it could write to.
        buffer_(const_cast<char*>(bytes.data()), bytes.size()),
        cdr_(buffer_, eprosima::fastcdr::Cdr::DEFAULT_ENDIAN, eprosima::fastcdr::Cdr::DDS_CDR) {}

  StatusOr<MessageValue> Decode() {
    try {
      cdr_.read_encapsulation();
      MessageValue value(Message(definition_.root()));
      if (Left() > kMaxPaddingBytes) {
        return InvalidArgument("{} bytes behind the message: the definition is another's", Left());
      }
      return value;
    } catch (const eprosima::fastcdr::exception::Exception&) {
      return InvalidArgument("ends inside a field, after {} bytes", bytes_.size());
    }
  }

 private:
  std::size_t Left() { return bytes_.size() - cdr_.getSerializedDataLength(); }

  template <typename T>
  T Read() {
    T value{};
    cdr_.deserialize(value);
    return value;
  }

  MessageValue::Fields Message(const MessageType& type) {
    MessageValue::Fields message{&type, {}};
    // A message without fields is a byte, so that every element of an array takes one at least.
    if (type.fields.empty()) Read<std::uint8_t>();
    message.values.reserve(type.fields.size());
    for (const MessageField& field : type.fields) message.values.push_back(Field(field));
    return message;
  }

  MessageValue Field(const MessageField& field) {
    if (field.count == Count::kOne) return One(field);
    const std::size_t count =
        field.count == Count::kFixed ? field.fixed_count : Read<std::uint32_t>();
    // Every element takes a byte at least.
    if (count > Left()) throw eprosima::fastcdr::exception::NotEnoughMemoryException("count");
    if (field.kind == Kind::kUint8 || field.kind == Kind::kInt8 || field.kind == Kind::kBool) {
      std::string text(count, '\0');
      cdr_.deserializeArray(text.data(), count);
      return MessageValue(std::move(text));
    }
    if (field.kind == Kind::kMessage || field.kind == Kind::kString) {
      std::vector<MessageValue> values;
      for (std::size_t i = 0; i < count; ++i) values.push_back(One(field));
      return MessageValue(std::move(values));
    }
    std::vector<double> numbers;
    for (std::size_t i = 0; i < count; ++i) numbers.push_back(One(field).Number("").value());
    return MessageValue(std::move(numbers));
  }

  MessageValue One(const MessageField& field) {
    switch (field.kind) {
      case Kind::kBool:
      case Kind::kUint8:
        return MessageValue(std::int64_t{Read<std::uint8_t>()});
      case Kind::kInt8:
        return MessageValue(std::int64_t{Read<std::int8_t>()});
      case Kind::kInt16:
        return MessageValue(std::int64_t{Read<std::int16_t>()});
      case Kind::kUint16:
        return MessageValue(std::int64_t{Read<std::uint16_t>()});
      case Kind::kInt32:
        return MessageValue(std::int64_t{Read<std::int32_t>()});
      case Kind::kUint32:
        return MessageValue(std::int64_t{Read<std::uint32_t>()});
      case Kind::kInt64:
        return MessageValue(Read<std::int64_t>());
      case Kind::kUint64:
        return MessageValue(Read<std::uint64_t>());
      case Kind::kFloat32:
        return MessageValue(double{Read<float>()});
      case Kind::kFloat64:
        return MessageValue(Read<double>());
      case Kind::kString:
        return MessageValue(Read<std::string>());
      case Kind::kMessage:
        break;
    }
    return MessageValue(Message(definition_.types()[field.message]));
  }

  const MessageDefinition& definition_;
  std::string_view bytes_;
  eprosima::fastcdr::FastBuffer buffer_;
  eprosima::fastcdr::Cdr cdr_;
};

Status CheckEncapsulation(std::string_view bytes) {
  if (bytes.size() < kEncapsulationBytes) {
    return InvalidArgument("{} bytes, expected {} or more", bytes.size(), kEncapsulationBytes);
  }
  const auto first = static_cast<unsigned char>(bytes[0]);
  const auto second = static_cast<unsigned char>(bytes[1]);
  if (first == 0 && (second == kBigEndian || second == kLittleEndian)) return OkStatus();
  return InvalidArgument("encoding {:#04x}{:02x}, this build reads plain CDR", first, second);
}

}  // namespace

StatusOr<MessageValue> DecodeCdr(const MessageDefinition& definition, std::string_view bytes) {
  const auto fail = [&](const Status& status) {
    return InvalidArgument("message of {}: {}", definition.root().name, Message(status));
  };
  if (bytes.size() > kMaxMessageBytes) {
    return fail(InvalidArgument("{} bytes, expected at most {}", bytes.size(), kMaxMessageBytes));
  }
  if (const Status status = CheckEncapsulation(bytes); !status.ok()) return fail(status);
  StatusOr<MessageValue> value = Decoder(definition, bytes).Decode();
  if (!value.ok()) return fail(value.status());
  return value;
}

}  // namespace shiftmap::rosbag2
