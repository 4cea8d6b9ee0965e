// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "mapstore/cli/context.h"
#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What of an area the page gets.
struct MapDocumentOptions {
  /// The one that is shown first; nothing: the published one.
  std::optional<VersionNumber> version = std::nullopt;

  /// The time that is shown first; nothing: now.
  std::optional<Stamp> at = std::nullopt;

  /// What was known then: versions, visits and probabilities; nothing: now.
  std::optional<Stamp> known = std::nullopt;

  /// A file that `shiftmap-localizer run --recording` wrote.
  std::optional<std::string> replay = std::nullopt;

  /// Of all chains with a rhythm; those beyond are shown with their mean rates.
  std::int64_t max_rhythm_rates = 100'000;
};

/// The data document of the page; page/data.ts, which reads it, has its layout. Names are text as
/// InertLine() leaves them.
///
/// Errors: those of MapStore; kNotFound if the area has no published version and none is named.
StatusOr<Json> MapDocument(const std::string& area,
                           const MapDocumentOptions& options,
                           MapStore* store);

}  // namespace shiftmap
