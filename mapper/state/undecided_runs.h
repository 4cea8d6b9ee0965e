// SPDX-License-Identifier: Apache-2.0
//
// Runs of a build that are not in its map, or not as one of them.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "mapper/alignment/explanation.h"
#include "mapper/index.h"
#include "proto/core/status.h"

namespace shiftmap {

/// How a build refers to a run that it may not have mapped.
struct RunName {
  std::string name;
  std::string sha256;  ///< Of the log file.
};

/// A run that could not be used, and why.
struct RejectedRun {
  std::string name;
  std::string reason;
  bool is_mapped = false;  ///< Its log, or one with all of it, is in the map.
};

/// "run 'a': reason; run 'b': reason", of the first runs that are not mapped; how many more there
/// are.
std::string ReasonsOf(const std::vector<RejectedRun>& rejected);

/// kInvalidArgument with the reasons if there is no run.
Status RequireRuns(bool any, const std::vector<RejectedRun>& rejected);

/// How much worse a run fits with its landmarks where a joint map has them than by itself
/// (mapper/METHOD.md, 6).
struct JoinedFit {
  std::vector<GroupIndex> groups;  ///< That the run shares with others or the prior map, ascending.

  /// Twice the log-likelihood ratio: χ² of `dof` degrees of freedom if these stand there.
  double chi2 = 0.0;
  int dof = 0;
  double limit = 0.0;  ///< Of chi2.

  bool is_good() const { return chi2 <= limit; }
};

/// Runs that wait: they agree with each other, may lie at several places in the map, and nothing
/// decides between these; or a run that does not fit at the place that was decided for; or one of
/// which it is not decided which landmarks of a part moved (RemoveAmbiguousRun).
struct WaitingRuns {
  std::vector<RunName> runs;
  Explanations explanations;        ///< Of one that does not fit: none.
  std::optional<JoinedFit> misfit;  ///< Of one that does not fit.
};

/// Runs whose place in the map is decided, but not which of their landmarks stayed. Each landmark
/// in doubt keeps the mode that it may have left, and has one beside it.
struct KeptAlternatives {
  struct Doubt {
    GroupIndex group;
    Eigen::Vector2d place = Eigen::Vector2d::Zero();  ///< Of the mode that it may have left. [m]
    double stayed = 0.0;                              ///< Probability that it did not leave it.
  };

  std::vector<RunName> runs;
  std::vector<StayedSet> alternatives;
  std::vector<GroupIndex> groups;  ///< In common, ascending.
  std::vector<Doubt> doubts;
};

}  // namespace shiftmap
