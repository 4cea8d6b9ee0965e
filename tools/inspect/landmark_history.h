// SPDX-License-Identifier: Apache-2.0
//
// The history of a landmark as data: for tables, pictures, pages and bindings alike.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Squared Mahalanobis distance beyond which a position has moved: the 95 % quantile of the
/// chi-square distribution with 2 degrees of freedom.
inline constexpr double kMovedSquaredMahalanobis = 5.991;

/// The probability of a mode.
struct ModeProbability {
  ModeNumber mode;  ///< kAbsent first, then by number.
  double probability = 0.0;
};

/// The probabilities of all modes at a time.
struct ModeProbabilities {
  Stamp stamp;

  /// As the version that was asked for has the modes; sums to 1. Empty where the store does not
  /// tell: a snapshot that begins later, or a landmark that the version does not have.
  std::vector<ModeProbability> modes;
};

/// One visit of the landmark, mapped by a build or reported by a shift.
struct HistoryVisit {
  Stamp begin;  ///< First and last scan of the visit.
  Stamp end;
  std::string vehicle;
  std::string run;        ///< RunRecord::identity, or UUID of the report of a shift without a log.
  std::string run_name;   ///< The log file's stem; empty if no build has read the log.
  bool mapped = false;    ///< By a build; else reported by a shift.
  std::string report;     ///< UUID of the shift report; empty if mapped.
  VersionNumber version;  ///< The one that mapped the run, or the one driven on.
  Stamp arrived;          ///< When the store got it.
  std::int64_t observations = 0;  ///< Scans of the visit in which the landmark was seen.

  /// One per mode that was known to whoever made the row. [nat]
  std::vector<VisitEvidence::ModeLogLikelihood> log_likelihoods;

  ModeNumber likely_mode;  ///< Most likely by the evidence of this visit alone,
  double log_odds = 0.0;   ///< against the next most likely; 0: it tells nothing. [nat]

  /// What stands for likely_mode in the version that was asked for; nothing if nothing does.
  std::optional<ModeNumber> current_mode;

  /// The first version of the line that has current_mode; nothing for kAbsent.
  std::optional<VersionNumber> known_since;
  bool or_before = false;  ///< As ModeHistory::or_before.

  std::optional<Decision> decision;   ///< The localizer's last one inside the visit.
  std::optional<SetAside> set_aside;  ///< Why the row does not count; nothing: it counts.

  /// Filtered: after the visit and all before it, at its end; empty if it does not count.
  std::vector<ModeProbability> probabilities;
};

/// Where a version has a mode.
struct ModePosition {
  VersionNumber version;
  Eigen::Vector2d p_map_landmark = Eigen::Vector2d::Zero();      ///< [m]
  Eigen::Matrix2d cov_p_map_landmark = Eigen::Matrix2d::Zero();  ///< Order (x, y). [m²]
};

/// One mode of the landmark over the versions of the line.
struct ModeHistory {
  ModeNumber number;

  /// The newest position that the line has; the version of it is the one that was asked for, unless
  /// the mode is gone.
  ModePosition position;

  double probability = 0.0;               ///< At LandmarkHistory::stamp; 0 if it is gone.
  Stamp last_seen;                        ///< Mode::last_seen of `position`.
  std::optional<ModeNumber> merged_into;  ///< The mode that stands for it now.
  bool gone = false;                      ///< The version does not have it: merged, or removed.
  VersionNumber first_version;            ///< The oldest stored version of the line that has it,
  bool or_before = false;                 ///< whose parent is not stored: it may have had it, too.

  /// Visits that count, saw the landmark, and by their evidence alone have this as most likely
  /// mode; their number, and the first and last of them as indices in LandmarkHistory::visits.
  int visits = 0;
  std::optional<std::size_t> first_visit;
  std::optional<std::size_t> last_visit;

  /// The first position, then each that is more than kMovedSquaredMahalanobis from the one before
  /// it here, by the sum of both covariances.
  std::vector<ModePosition> positions;
};

/// Why the map says of a landmark what it says.
struct LandmarkHistory {
  std::string area;
  Signature signature;
  VersionNumber version;       ///< The map version that it is told for.
  Stamp stamp;                 ///< Of the probabilities.
  std::optional<Stamp> known;  ///< As known then; nothing: now.
  bool in_version = false;     ///< The version has the landmark. If not, no row counts.

  std::vector<ModeProbability> probabilities;  ///< At `stamp`; empty if not in_version.
  double move_rate_per_s = 0.0;                ///< MoveRate() of the chain.
  std::vector<ModeHistory> modes;              ///< Of the line, by number; not kAbsent.
  std::vector<HistoryVisit> visits;            ///< Oldest first.

  /// What a version states of the landmark, as an import does; it counts like a visit.
  struct Statement {
    VersionNumber version;
    ModeProbabilities probabilities;
  };
  std::optional<Statement> statement;

  std::vector<VersionNumber> versions;   ///< Those of the area that have the landmark.
  std::vector<VersionNumber> mapped_by;  ///< Those that mapped a visit of it.

  std::vector<ModeProbabilities>
      track;  ///< By HistoryOptions::track, then what choose_track added.
};

struct HistoryOptions {
  /// Nothing: the published one, at `known` if given.
  std::optional<VersionNumber> version = std::nullopt;

  /// Time of the probabilities; later visits are left out. Nothing: the newest end of the evidence.
  std::optional<Stamp> at = std::nullopt;

  std::optional<Stamp> known = std::nullopt;  ///< What was known then; nothing: now.

  /// Times for LandmarkHistory::track, in any order: the probabilities then, also before the
  /// version was made.
  std::vector<Stamp> track = {};

  /// More of them, as LandmarkQuery::choose_track.
  decltype(LandmarkQuery::choose_track) choose_track = {};
};

/// Reads the history of a landmark: one pass over the ledger, and no map is loaded twice.
/// Errors: as MapStore::LoadLandmark.
StatusOr<LandmarkHistory> LoadLandmarkHistory(MapStore* store,
                                              const std::string& area,
                                              const Signature& signature,
                                              const HistoryOptions& options = {});

}  // namespace shiftmap
