// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"

namespace shiftmap {

/// What one visit says about where a landmark is: the log-likelihood of everything seen and not
/// seen, prior excluded, so that several vehicles' evidence can be added without counting a prior
/// twice.
struct VisitEvidence {
  Signature signature;
  Stamp begin;  ///< First and last scan of the visit.
  Stamp end;

  /// One value for `absent` and for each mode of the map version it was computed against.
  struct ModeLogLikelihood {
    ModeNumber mode;
    double log_likelihood = 0.0;  ///< Up to a constant common to the visit. [nat]
  };
  std::vector<ModeLogLikelihood> modes;  ///< By ascending mode number, `absent` first.

  std::int64_t observations = 0;  ///< Scans of the visit in which the landmark was seen.
};

/// The sequential test decided that a mode holds, T-IV (17).
struct Decision {
  Signature signature;
  ModeNumber mode;
  Stamp stamp;            ///< Of the scan that decided.
  double log_odds = 0.0;  ///< Smallest log-ratio to any other mode. [nat]
};

/// Observations that gate with no known mode, condensed.
struct UnmappedSighting {
  Signature signature;
  Eigen::Vector2d p_map_landmark = Eigen::Vector2d::Zero();      ///< [m]
  Eigen::Matrix2d cov_p_map_landmark = Eigen::Matrix2d::Zero();  ///< Order (x, y). [m²]
  std::int64_t count = 0;
  Stamp first;
  Stamp last;
};

/// Scans, odometry samples or single observations that did not count.
struct DroppedCount {
  std::string reason;  ///< A word, e.g. "unknown_signature".
  std::int64_t count = 0;
};

/// What a localizer returns after a shift.
struct ShiftReport {
  std::string uuid;  ///< RFC 4122 text form; a report that arrives twice counts once.
  std::string vehicle;
  std::string area;
  VersionNumber version;     ///< The map version driven on,
  std::string content_hash;  ///< and its content hash.
  std::string run_hash;      ///< SHA-256 of the run log in hex; empty for a live stream.
  std::string run_uuid;      ///< Of the run, as its log has it; empty if that has none.
  std::string software;      ///< Name and version of what made the report.
  Stamp begin;               ///< First and last stamp of the shift.
  Stamp end;
  std::vector<VisitEvidence> evidence;
  std::vector<Decision> decisions;
  std::vector<UnmappedSighting> sightings;
  std::vector<DroppedCount> dropped;  ///< Each reason once.
};

}  // namespace shiftmap
