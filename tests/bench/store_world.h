// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>
#include <random>
#include <string>

#include "mapstore/map_store.h"
#include "proto/core/check.h"
#include "tests/support/random_map.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {

/// A store with one area 'a' of `groups` groups with 3 modes each.
struct World {
  explicit World(int groups) {
    RandomMapOptions options;
    options.groups = groups;
    options.max_modes = 5;
    std::mt19937_64 random(1);
    content = RandomContent(random, options);
    StatusOr<MapStore> opened =
        MapStore::Open(dir.File("a.db"), MapStore::Access::kReadWriteCreate);
    SHIFTMAP_CHECK(opened.ok(), "{}", Message(opened.status()));
    store.emplace(*std::move(opened));
    Commit();
  }

  void Commit() {
    const StatusOr<CommitResult> result = store->Commit("a", content, {}, {});
    SHIFTMAP_CHECK(result.ok(), "{}", Message(result.status()));
    version = *result;
  }

  /// A report with one visit of each of the first `visits` groups, again and again.
  ShiftReport Report(int visits) {
    ShiftReport report;
    report.uuid = fmt::format("{:08x}-0000-4000-8000-000000000000", reports++);
    report.vehicle = "v";
    report.software = "store_bench";
    report.area = "a";
    report.version = version.version;
    report.content_hash = version.content_hash;
    std::mt19937_64 random(static_cast<std::uint64_t>(reports));
    Stamp begin = content.stamp + std::chrono::hours(reports);
    report.begin = begin;
    for (int i = 0; i < visits; ++i) {
      const auto group = static_cast<std::size_t>(i) % content.groups.size();
      begin += std::chrono::seconds(1);
      report.evidence.push_back(RandomEvidence(random, content.groups[group], begin, begin));
    }
    report.end = begin;
    return report;
  }

  void Return(const ShiftReport& report) {
    const StatusOr<ReturnResult> result = store->Return(report);
    SHIFTMAP_CHECK(result.ok(), "{}", Message(result.status()));
  }

  TempDir dir;
  MapContent content;
  std::optional<MapStore> store;
  CommitResult version;
  int reports = 0;
};

}  // namespace shiftmap::testing
