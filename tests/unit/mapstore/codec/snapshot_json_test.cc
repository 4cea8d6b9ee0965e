// SPDX-License-Identifier: Apache-2.0
#include "mapstore/codec/snapshot_json.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

namespace shiftmap {
namespace {

TEST(SnapshotJson, ReadsBackWhatItSays) {
  SnapshotInfo snapshot;
  snapshot.area = "level \"3\"";
  snapshot.version = VersionNumber(7);
  snapshot.content_hash = std::string(64, 'c');
  snapshot.ledger_sequence = LedgerPosition(12);
  snapshot.created = StampFromSeconds(1'767'000'000);
  snapshot.sha256 = std::string(64, 'a');
  snapshot.size_bytes = 4096;
  snapshot.signatures = {{std::string(64, 'b'), std::string("\x00\xff\x10", 3)}};
  const nlohmann::ordered_json json = SnapshotJson(snapshot);
  EXPECT_EQ(json["signatures"][0]["signature"], "00ff10");
  EXPECT_EQ(json["file"], snapshot.sha256 + ".db");
  const SnapshotInfo back = SnapshotFromJson(nlohmann::ordered_json::parse(json.dump()));
  EXPECT_EQ(SignedText(back), SignedText(snapshot));
  EXPECT_EQ(back.created, snapshot.created);
  EXPECT_EQ(back.size_bytes, snapshot.size_bytes);
  ASSERT_EQ(back.signatures.size(), 1u);
  EXPECT_EQ(back.signatures[0].key_sha256, snapshot.signatures[0].key_sha256);
  EXPECT_EQ(back.signatures[0].signature, snapshot.signatures[0].signature);
}

TEST(SnapshotJson, WhatIsMissingThrows) {
  nlohmann::ordered_json json = SnapshotJson({});
  json.erase("sha256");
  EXPECT_THROW(SnapshotFromJson(json), nlohmann::ordered_json::exception);
}

}  // namespace
}  // namespace shiftmap
