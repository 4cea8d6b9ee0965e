// SPDX-License-Identifier: Apache-2.0
#include "proto/mcap/definitions.h"

#include <utility>

#include "proto/mcap/byte_reader.h"
#include "proto/mcap/format.h"

namespace shiftmap::mcap {

Status Definitions::Count(std::size_t bytes) {
  bytes_ += bytes;
  if (bytes_ > kMaxDefinitionBytes) {
    return DataLoss("schemas and channels: names and texts above {} bytes", kMaxDefinitionBytes);
  }
  return OkStatus();
}

Status Definitions::AddSchema(std::string_view content) {
  ByteReader reader(content);
  const auto id = reader.Read<std::uint16_t>();
  Schema schema;
  schema.name = reader.String();
  schema.encoding = reader.String();
  const std::string_view data = reader.String();
  if (!reader.ok()) return DataLoss("schema: fields beyond its {} bytes", content.size());
  if (id == 0) return DataLoss("schema '{}': id 0, expected 1 or more", schema.name);
  if (const auto known = schemas_.find(id); known != schemas_.end()) {
    if (known->second.name == schema.name && known->second.encoding == schema.encoding &&
        *known->second.data == data) {
      return OkStatus();
    }
    return DataLoss("schema {}: '{}', was '{}'", id, schema.name, known->second.name);
  }
  SHIFTMAP_RETURN_IF_ERROR(Count(schema.name.size() + schema.encoding.size() + data.size()));
  schema.data = std::make_shared<const std::string>(data);
  schemas_.emplace(id, std::move(schema));
  return OkStatus();
}

Status Definitions::AddChannel(std::string_view content) {
  ByteReader reader(content);
  const auto id = reader.Read<std::uint16_t>();
  ChannelEntry entry;
  entry.schema_id = reader.Read<std::uint16_t>();
  entry.channel.topic = reader.String();
  entry.channel.message_encoding = reader.String();
  reader.String();  // Metadata, a map.
  if (!reader.ok()) return DataLoss("channel: fields beyond its {} bytes", content.size());
  if (const auto known = channels_.find(id); known != channels_.end()) {
    if (known->second.schema_id == entry.schema_id &&
        known->second.channel.topic == entry.channel.topic &&
        known->second.channel.message_encoding == entry.channel.message_encoding) {
      return OkStatus();
    }
    return DataLoss(
        "channel {}: '{}', was '{}'", id, entry.channel.topic, known->second.channel.topic);
  }
  if (entry.schema_id != 0) {
    const auto schema = schemas_.find(entry.schema_id);
    if (schema == schemas_.end()) {
      return DataLoss(
          "channel '{}': schema {} is not defined", entry.channel.topic, entry.schema_id);
    }
    entry.channel.schema_name = schema->second.name;
    entry.channel.schema_encoding = schema->second.encoding;
    entry.channel.schema_data = schema->second.data;
  }
  SHIFTMAP_RETURN_IF_ERROR(
      Count(entry.channel.topic.size() + entry.channel.message_encoding.size() +
            entry.channel.schema_name.size() + entry.channel.schema_encoding.size()));
  channels_.emplace(id, std::move(entry));
  return OkStatus();
}

const Channel* Definitions::FindChannel(std::uint16_t id) const {
  const auto found = channels_.find(id);
  return found == channels_.end() ? nullptr : &found->second.channel;
}

}  // namespace shiftmap::mcap
