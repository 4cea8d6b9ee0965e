// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <random>
#include <string>

#include "localizer/transfer/map_client.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/map_store.h"
#include "tests/support/fake_map_server.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::transfer {

/// A vehicle's folder and a map server in this process.
class TransferTest : public ::testing::Test {
 protected:
  ServerOptions ToServer() const {
    ServerOptions options;
    options.address = server_.address();
    options.development_plain_text = true;
    options.call_deadline_s = 20.0;
    return options;
  }

  MapClient Client(std::stop_token stop = {}) const {
    StatusOr<MapClient> client = MapClient::Create(ToServer(), std::move(stop));
    EXPECT_THAT(client, testing::IsOk());
    return *std::move(client);
  }

  // A snapshot of area `floor` whose content depends on `seed`.
  testing::FakeMapServer::Snapshot Made(std::uint64_t seed) {
    const testing::TempDir folder;
    auto store = MapStore::Open(folder.File("maps.db"), MapStore::Access::kReadWriteCreate);
    EXPECT_THAT(store, testing::IsOk());
    std::mt19937_64 random(seed);
    const auto commit =
        store->Commit("floor", testing::RandomContent(random), Provenance(), CommitOptions());
    EXPECT_THAT(commit, testing::IsOk());
    EXPECT_THAT(store->ExportSnapshot("floor", folder.File("snapshot.db")), testing::IsOk());
    testing::FakeMapServer::Snapshot snapshot;
    snapshot.content_hash = store->LoadAt("floor")->content_hash();
    snapshot.bytes = testing::ReadFile(folder.File("snapshot.db"));
    return snapshot;
  }

  static ShiftReport Report() {
    ShiftReport report;
    report.uuid = RandomUuid();
    report.vehicle = "truck-7";
    report.area = "floor";
    report.version = VersionNumber(1);
    report.content_hash = std::string(64, 'a');
    report.software = "test";
    report.begin = StampFromNanoseconds(1'700'000'000'000'000'000);
    report.end = StampFromNanoseconds(1'700'000'100'000'000'000);
    return report;
  }

  testing::TempDir folder_;
  testing::FakeMapServer server_;
};

}  // namespace shiftmap::transfer
