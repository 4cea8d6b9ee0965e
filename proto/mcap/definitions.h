// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "proto/core/status.h"
#include "proto/mcap/reader.h"

namespace shiftmap::mcap {

/// The schemas and channels that a file has defined so far, of at most kMaxDefinitionBytes
/// together.
class Definitions {
 public:
  /// Takes the content of a schema or channel record. A definition may be repeated.
  /// Errors: kDataLoss if the record is cut short, a channel names a schema that is not defined, an
  /// id is defined a second time differently, or there are too many.
  Status AddSchema(std::string_view content);
  Status AddChannel(std::string_view content);

  /// The channel of an id, or null. Valid as long as this object.
  const Channel* FindChannel(std::uint16_t id) const;

 private:
  struct Schema {
    std::string name;
    std::string encoding;
    std::shared_ptr<const std::string> data;
  };
  struct ChannelEntry {
    Channel channel;
    std::uint16_t schema_id = 0;
  };

  Status Count(std::size_t bytes);

  std::map<std::uint16_t, Schema> schemas_;
  std::map<std::uint16_t, ChannelEntry> channels_;
  std::uint64_t bytes_ = 0;
};

}  // namespace shiftmap::mcap
