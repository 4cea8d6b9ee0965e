// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/bag_reader.h"

#include <algorithm>
#include <limits>
#include <map>
#include <utility>

#include "mapstore/core/input_file.h"
#include "mapstore/sqlite/database.h"
#include "proto/mcap/reader.h"

namespace shiftmap::rosbag2 {
namespace {

constexpr std::size_t kMaxTopics = 10'000;
constexpr std::size_t kMaxDefinitionBytes = std::size_t{16} << 20;

// MCAP writers of ROS call definitions so; those in IDL are not read.
constexpr std::string_view kMessageText = "ros2msg";

Status OfFile(const std::string& path, const Status& status) {
  if (status.ok()) return status;
  const std::string name = fmt::format("bag '{}'", path);
  const std::string message = Message(status);
  if (message.starts_with(name)) return status;
  return MakeStatus(status.code(), "{}: {}", name, message);
}

Status OfTopic(const BagTopic& topic, const Status& status) {
  return Annotate(status, "topic '{}'", topic.name);
}

StatusOr<Database> OpenDatabase(const std::string& path, const std::string& name, bool copied) {
  Database::Options options;
  // A log of writes is taken in by opening the copy for writing.
  options.mode = copied ? Database::Mode::kReadWrite : Database::Mode::kReadOnly;
  options.immutable = !copied;
  options.allow_network_file_system = true;
  options.name = name;
  return Database::Open(path, options);
}

StatusOr<bool> HasTable(Database& database, const char* name) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT 1 FROM sqlite_schema WHERE type = 'table' AND name = ?1"));
  query.Bind(name);
  return query.Step();
}

using Definitions = std::map<std::string, std::shared_ptr<const std::string>>;

// ROS 2 Iron and later keep them in a table.
StatusOr<Definitions> ReadDefinitions(Database& database) {
  Definitions definitions;
  SHIFTMAP_ASSIGN_OR_RETURN(const bool there, HasTable(database, "message_definitions"));
  if (!there) return definitions;
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT topic_type, encoded_message_definition FROM message_definitions "
                       "WHERE encoding = ?1"));
  query.Bind(kMessageText);
  std::size_t bytes = 0;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return definitions;
    bytes += query.Blob(0).size() + query.Blob(1).size();
    if (bytes > kMaxDefinitionBytes) {
      return InvalidArgument("definitions of more than {} bytes", kMaxDefinitionBytes);
    }
    definitions[query.Text(0)] = std::make_shared<const std::string>(query.Text(1));
  }
}

StatusOr<std::map<std::int64_t, std::int64_t>> CountMessages(Database& database) {
  std::map<std::int64_t, std::int64_t> counts;
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT topic_id, count(*) FROM messages GROUP BY topic_id"));
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return counts;
    counts[query.Int64(0)] = query.Int64(1);
    if (counts.size() > kMaxTopics) return InvalidArgument("more than {} topics", kMaxTopics);
  }
}

Stamp StampOfLogTime(std::uint64_t log_time_ns) {
  constexpr auto kMax = static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
  return StampFromNanoseconds(static_cast<std::int64_t>(std::min(log_time_ns, kMax)));
}

}  // namespace

StatusOr<Bag> Bag::Open(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<BagFile> files, FindBagFiles(path));
  Bag bag;
  for (const BagFile& file : files) {
    SHIFTMAP_RETURN_IF_ERROR(OfFile(file.path, bag.AddFile(file)));
  }
  std::sort(bag.topics_.begin(), bag.topics_.end(), [](const BagTopic& a, const BagTopic& b) {
    return a.name < b.name;
  });
  return bag;
}

Status Bag::AddFile(const BagFile& file) {
  OpenFile open{file, file.path, false};
  const bool sqlite = file.storage == BagFile::Storage::kSqlite;
  if (file.zstd || (sqlite && HasWriteAheadLog(file.path))) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        ScratchCopy copy,
        file.zstd ? ScratchCopy::Decompress(file.path) : ScratchCopy::WithWriteAheadLog(file.path));
    open.path = copy.path();
    open.copied = true;
    copies_.push_back(std::move(copy));
  }
  SHIFTMAP_RETURN_IF_ERROR(sqlite ? ListSqlite(open) : ListMcap(open));
  files_.push_back(std::move(open));
  return OkStatus();
}

Status Bag::AddTopic(BagTopic topic) {
  if (topic.definition != nullptr && topic.definition->empty()) topic.definition = nullptr;
  const auto known = std::find_if(topics_.begin(), topics_.end(), [&](const BagTopic& other) {
    return other.name == topic.name;
  });
  if (known == topics_.end()) {
    if (topics_.size() == kMaxTopics) return InvalidArgument("more than {} topics", kMaxTopics);
    topics_.push_back(std::move(topic));
    return OkStatus();
  }
  if (known->type != topic.type || known->encoding != topic.encoding) {
    return InvalidArgument(
        "topic '{}' is of type '{}' and of type '{}'", topic.name, known->type, topic.type);
  }
  if (known->definition == nullptr) known->definition = std::move(topic.definition);
  known->messages += topic.messages;
  return OkStatus();
}

Status Bag::ListMcap(const OpenFile& file) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::ifstream in, OpenInputFile(file.path));
  SHIFTMAP_ASSIGN_OR_RETURN(mcap::Reader reader, mcap::Reader::Open(&in));
  std::map<const mcap::Channel*, std::int64_t> counts;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const auto message, reader.Next());
    if (!message) break;
    ++counts[message->channel];
  }
  for (const auto& [channel, count] : counts) {
    BagTopic topic;
    topic.name = channel->topic;
    topic.type = channel->schema_name;
    topic.encoding = channel->message_encoding;
    if (channel->schema_encoding == kMessageText) topic.definition = channel->schema_data;
    topic.messages = count;
    SHIFTMAP_RETURN_IF_ERROR(AddTopic(std::move(topic)));
  }
  if (!reader.truncation().empty()) {
    truncations_.push_back(fmt::format("bag '{}': {}", file.file.path, reader.truncation()));
  }
  return OkStatus();
}

Status Bag::ListSqlite(const OpenFile& file) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Database database,
      OpenDatabase(file.path, fmt::format("bag '{}'", file.file.path), file.copied));
  SHIFTMAP_ASSIGN_OR_RETURN(const Definitions definitions, ReadDefinitions(database));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto counts, CountMessages(database));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query, database.Prepare("SELECT id, name, type, serialization_format FROM topics"));
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return OkStatus();
    BagTopic topic;
    topic.name = query.Text(1);
    topic.type = query.Text(2);
    topic.encoding = query.Text(3);
    const auto definition = definitions.find(topic.type);
    if (definition != definitions.end()) topic.definition = definition->second;
    const auto count = counts.find(query.Int64(0));
    if (count != counts.end()) topic.messages = count->second;
    SHIFTMAP_RETURN_IF_ERROR(AddTopic(std::move(topic)));
  }
}

Status Bag::ForEachMessage(const std::vector<const BagTopic*>& topics, const Take& take) const {
  std::string buffer;
  const Take take_plain = [&](const BagMessage& message) -> Status {
    BagMessage plain = message;
    const auto data = PlainMessage(message.data, &buffer);
    if (!data.ok()) return OfTopic(*message.topic, data.status());
    plain.data = *data;
    return OfTopic(*message.topic, take(plain));
  };
  for (const OpenFile& file : files_) {
    const Status status = file.file.storage == BagFile::Storage::kSqlite
                              ? ReadSqlite(file, topics, take_plain)
                              : ReadMcap(file, topics, take_plain);
    SHIFTMAP_RETURN_IF_ERROR(OfFile(file.file.path, status));
  }
  return OkStatus();
}

Status Bag::ReadMcap(const OpenFile& file,
                     const std::vector<const BagTopic*>& topics,
                     const Take& take) const {
  SHIFTMAP_ASSIGN_OR_RETURN(std::ifstream in, OpenInputFile(file.path));
  SHIFTMAP_ASSIGN_OR_RETURN(mcap::Reader reader, mcap::Reader::Open(&in));
  std::map<const mcap::Channel*, const BagTopic*> wanted;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const auto message, reader.Next());
    if (!message) return OkStatus();
    const auto [entry, added] = wanted.try_emplace(message->channel, nullptr);
    if (added) {
      for (const BagTopic* topic : topics) {
        if (topic->name == message->channel->topic) entry->second = topic;
      }
    }
    if (entry->second == nullptr) continue;
    SHIFTMAP_RETURN_IF_ERROR(
        take({entry->second, StampOfLogTime(message->log_time_ns), message->data}));
  }
}

Status Bag::ReadSqlite(const OpenFile& file,
                       const std::vector<const BagTopic*>& topics,
                       const Take& take) const {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Database database,
      OpenDatabase(file.path, fmt::format("bag '{}'", file.file.path), file.copied));
  std::map<std::int64_t, const BagTopic*> wanted;
  {
    SHIFTMAP_ASSIGN_OR_RETURN(Statement query, database.Prepare("SELECT id, name FROM topics"));
    for (;;) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
      if (!row) break;
      const std::string name = query.Text(1);
      for (const BagTopic* topic : topics) {
        if (topic->name == name) wanted[query.Int64(0)] = topic;
      }
    }
  }
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT topic_id, timestamp, data FROM messages ORDER BY id"));
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return OkStatus();
    // The data of other topics, such as pictures, stays on the disk.
    const auto found = wanted.find(query.Int64(0));
    if (found == wanted.end()) continue;
    SHIFTMAP_RETURN_IF_ERROR(
        take({found->second, StampFromNanoseconds(query.Int64(1)), query.Blob(2)}));
  }
}

}  // namespace shiftmap::rosbag2
