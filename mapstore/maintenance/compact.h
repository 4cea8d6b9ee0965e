// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What a store keeps. Version rows with their hash and provenance, reports by UUID, runs, unmapped
/// sightings and the audit log stay whatever the policy says.
struct RetentionPolicy {
  /// Per area: the content of the newest versions, of the published one, and of the builds that
  /// these are edits of.
  int keep_versions = 30;

  /// Evidence rows of visits that ended before this, and the decisions of such shifts, go unless
  /// they count for a version whose content is kept, or would without another copy of their log.
  /// Nothing: all stay.
  std::optional<Stamp> evidence_before;

  /// Of evidence that began before this, rows go that repeat others, as the published version sees
  /// them (ThinLedger). Nothing: all stay.
  std::optional<Stamp> thin_before = std::nullopt;
};

struct CompactResult {
  std::int64_t versions = 0;       ///< Whose content was deleted.
  std::int64_t evidence_rows = 0;  ///< Deleted, as no version needs them.
  std::int64_t thinned_rows = 0;   ///< Deleted, as they repeat others.
  std::int64_t decisions = 0;      ///< Deleted.
  std::uintmax_t bytes_before = 0;
  std::uintmax_t bytes_after = 0;
};

/// Deletes what the policy does not keep and returns the space to the file system. The
/// probabilities of the versions that are kept do not change, but for what ThinLedger
/// loses, as its header lists.
/// @param dry_run  Says what would be deleted, deletes nothing.
/// Errors: kInvalidArgument if the policy keeps no version; else as MapStore. After an error the
/// store holds either everything or what the policy keeps.
StatusOr<CompactResult> CompactStore(const std::string& path,
                                     const RetentionPolicy& policy,
                                     bool dry_run);

/// Deletes the content of some versions of an area and what they alone say of the ledger; the file
/// keeps the space for what comes. Left are those that are published, or that another version or a
/// report is about. Returns how many lost their content.
/// Errors: as MapStore.
StatusOr<std::int64_t> CompactVersions(const std::string& path,
                                       const std::string& area,
                                       const std::vector<VersionNumber>& versions);

}  // namespace shiftmap
