// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap::testing {

/// What one area of a map store should say, by the rules of mapstore/README.md and without any of
/// the store's code: every version and every report in memory, every question answered from
/// scratch.
class StoreModel {
 public:
  struct Version {
    MapContent content;
    std::optional<std::size_t> parent;  // Index in versions(); the number is the index + 1.
    std::size_t reports_known = 0;      // Reports that it accounts for, in the order of arrival.
    std::vector<std::string> run_hashes;
    bool stored = true;
  };

  std::size_t Commit(Version version);
  void Return(const ShiftReport& report);
  void Publish(std::size_t version) { published_ = version; }

  /// Leaves the content of the newest `keep` versions and of the published one.
  void Compact(std::size_t keep);

  const std::vector<Version>& versions() const { return versions_; }
  const std::vector<ShiftReport>& reports() const { return reports_; }
  std::optional<std::size_t> published() const { return published_; }
  bool Knows(const std::string& uuid) const;

  /// Probabilities of every group at a time.
  std::vector<Eigen::VectorXd> ProbabilitiesAt(std::size_t version, Stamp at) const;

 private:
  enum class Use { kNot, kInOrder, kLate };
  Use UseOf(std::size_t report, const VisitEvidence& visit, std::size_t version) const;
  bool IsAncestor(std::size_t ancestor, std::size_t version) const;
  bool IsSuperseded(std::size_t report) const;

  std::vector<Version> versions_;
  std::vector<ShiftReport> reports_;
  std::optional<std::size_t> published_;
};

}  // namespace shiftmap::testing
