// SPDX-License-Identifier: Apache-2.0
#include "mapstore/codec/snapshot_json.h"

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "mapstore/core/hex.h"

namespace shiftmap {

using Json = nlohmann::ordered_json;

Json SnapshotJson(const SnapshotInfo& snapshot) {
  Json signatures = Json::array();
  for (const SnapshotSignature& each : snapshot.signatures) {
    signatures.push_back({{"key_sha256", each.key_sha256}, {"signature", ToHex(each.signature)}});
  }
  return {{"area", snapshot.area},
          {"version", snapshot.version.value()},
          {"content_hash", snapshot.content_hash},
          {"ledger_sequence", snapshot.ledger_sequence.value()},
          {"created_ns", ToNanoseconds(snapshot.created)},
          {"sha256", snapshot.sha256},
          {"file", snapshot.sha256 + ".db"},
          {"size_bytes", snapshot.size_bytes},
          {"signatures", signatures}};
}

SnapshotInfo SnapshotFromJson(const Json& json) {
  SnapshotInfo snapshot;
  snapshot.area = json.at("area").get<std::string>();
  snapshot.version = VersionNumber(json.at("version").get<std::int64_t>());
  snapshot.content_hash = json.at("content_hash").get<std::string>();
  snapshot.ledger_sequence = LedgerPosition(json.at("ledger_sequence").get<std::int64_t>());
  snapshot.created = StampFromNanoseconds(json.at("created_ns").get<std::int64_t>());
  snapshot.sha256 = json.at("sha256").get<std::string>();
  snapshot.size_bytes = json.at("size_bytes").get<std::int64_t>();
  for (const Json& each : json.at("signatures")) {
    snapshot.signatures.push_back({each.at("key_sha256").get<std::string>(),
                                   FromHex(each.at("signature").get<std::string>()).value_or("")});
  }
  return snapshot;
}

}  // namespace shiftmap
