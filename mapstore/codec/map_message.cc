// SPDX-License-Identifier: Apache-2.0
#include "mapstore/codec/map_message.h"

#include <google/protobuf/io/tokenizer.h>
#include <google/protobuf/stubs/logging.h>
#include <google/protobuf/text_format.h>
#include <google/protobuf/util/json_util.h>

#include "mapstore/codec/map_proto.h"
#include "mapstore/codec/parse_proto.h"

namespace shiftmap {
namespace {

// Keeps the first error, and prints nothing.
class FirstError : public google::protobuf::io::ErrorCollector {
 public:
  void AddError(int line,
                google::protobuf::io::ColumnNumber column,
                const std::string& message) override {
    if (text_.empty()) text_ = fmt::format("{}:{}: {}", line + 1, column + 1, message);
  }

  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

Status ParseText(std::string_view text, proto::Map* message) {
  FirstError error;
  google::protobuf::TextFormat::Parser parser;
  parser.RecordErrorsTo(&error);
  if (parser.ParseFromString(std::string(text), message)) return OkStatus();
  return InvalidArgument("no map in Protobuf's text form: {}", error.text());
}

Status ParseJson(std::string_view text, proto::Map* message) {
  const auto status =
      google::protobuf::util::JsonStringToMessage({text.data(), text.size()}, message);
  if (status.ok()) return OkStatus();
  const std::string_view why(status.message().data(), status.message().size());
  return InvalidArgument("no map in Protobuf's JSON form: {}", why.substr(0, why.find('\n')));
}

}  // namespace

StatusOr<std::string> EncodeMap(const MapSnapshot& map, MapForm form) {
  proto::Map message;
  SHIFTMAP_RETURN_IF_ERROR(ToProto(map, &message));
  std::string text;
  bool printed = false;
  if (form == MapForm::kBinary) {
    printed = message.SerializeToString(&text);
  } else if (form == MapForm::kText) {
    printed = google::protobuf::TextFormat::PrintToString(message, &text);
  } else {
    google::protobuf::util::JsonPrintOptions options;
    options.add_whitespace = true;
    options.always_print_primitive_fields = true;
    options.preserve_proto_field_names = true;
    printed = google::protobuf::util::MessageToJsonString(message, &text, options).ok();
  }
  if (!printed) return Internal("map of area '{}': Protobuf did not print it", map.area());
  return text;
}

StatusOr<MapSnapshot> DecodeMap(std::string_view text, MapForm form) {
  const google::protobuf::LogSilencer silencer;  // It prints lines of its own about text.
  proto::Map message;
  if (form == MapForm::kBinary) {
    SHIFTMAP_RETURN_IF_ERROR(ParseProto(text, &message));
  } else if (form == MapForm::kText) {
    SHIFTMAP_RETURN_IF_ERROR(ParseText(text, &message));
  } else {
    SHIFTMAP_RETURN_IF_ERROR(ParseJson(text, &message));
  }
  return MapFromProto(message);
}

}  // namespace shiftmap
