// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/store_types.h"

namespace shiftmap::testing {

/// What one area of a map store should say, by the rules of mapstore/METHOD.md and without any of
/// the store's code: every version and every report in memory, every question answered from
/// scratch.
class StoreModel {
 public:
  struct Version {
    MapContent content;
    std::optional<std::size_t> parent;  // Index in versions(); the number is the index + 1.
    bool states = true;                 // Its content's probabilities are a statement,
    std::size_t reports_known = 0;      // which accounts for so many reports, in order of arrival.
    std::vector<RunRecord> runs;
    bool stored = true;
  };

  std::size_t Commit(Version version);
  void Return(const ShiftReport& report);
  void Publish(std::size_t version) { published_ = version; }
  void Exclude(const Exclusion& exclusion) {
    std::erase_if(exclusions_, [&](const Exclusion& other) {
      return other.run == exclusion.run && other.vehicle == exclusion.vehicle;
    });
    exclusions_.push_back(exclusion);
  }
  void Include(std::size_t index) {
    exclusions_.erase(exclusions_.begin() + static_cast<std::ptrdiff_t>(index));
  }
  const std::vector<Exclusion>& exclusions() const { return exclusions_; }

  /// Leaves the content of the newest `keep` versions and of the published one.
  void Compact(std::size_t keep);

  const std::vector<Version>& versions() const { return versions_; }
  const std::vector<ShiftReport>& reports() const { return reports_; }
  std::optional<std::size_t> published() const { return published_; }
  bool Knows(const std::string& uuid) const;

  /// Probabilities of every group at a time.
  std::vector<Eigen::VectorXd> ProbabilitiesAt(std::size_t version, Stamp at) const;
  bool IsExcluded(const std::string& run, const std::string& vehicle, Stamp begin) const;

 private:
  bool Counts(std::size_t report, const VisitEvidence& visit, std::size_t version) const;
  std::optional<std::size_t> StatementOf(std::size_t version) const;
  bool IsAncestor(std::size_t ancestor, std::size_t version) const;
  bool IsInLine(std::size_t upper, std::size_t version) const;
  std::vector<EvidenceRow> RowsOf(const LandmarkGroup& group, std::size_t version, Stamp at) const;
  bool IsOfLine(std::size_t other, std::size_t version) const;
  bool IsSuperseded(std::size_t report, std::size_t version) const;

  std::vector<Version> versions_;
  std::vector<ShiftReport> reports_;
  std::vector<Exclusion> exclusions_;
  std::optional<std::size_t> published_;
};

}  // namespace shiftmap::testing
