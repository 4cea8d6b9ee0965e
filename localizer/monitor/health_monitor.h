// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/circular_buffer.hpp>
#include <cstddef>
#include <optional>
#include <vector>

#include "localizer/monitor/landmark_distances.h"
#include "mapstore/core/stamp.h"

namespace shiftmap {

/// How many landmarks agree with the pose and how many do not, by the last observation of each.
struct PoseSupport {
  int agreeing = 0;
  int failing = 0;
  int turned = 0;        ///< Of those that fail, the ones that agreed less than ten seconds before.
  Stamp since;           ///< Of the oldest scan that counts.
  double nis_sum = 0.0;  ///< Of all observations that gated with a mode.
  int updates = 0;       ///< Their number.

  /// Enough to believe that a landmark that fails stands elsewhere: most others agree (up to a
  /// third of those in view may have moved at once), and not barely, as they do with a pose that is
  /// off by little.
  bool Confirms() const;

  /// More agree than do not, and not barely.
  bool Agrees() const;

  /// So few agree that the pose may be wrong.
  bool Doubts() const;
};

/// The probability with which as many landmarks fail, or more, if each has moved with probability
/// 1/3: about the most that ever moved at once.
double FailureTail(const PoseSupport& support);

/// When a vehicle counts as lost although no other pose explains the sightings, and when as found.
struct HealthOptions {
  /// Lost: over this time [s], and this number of observations at least, at most this share of them
  /// agreed. A longer time delays LOST, and avoids it where most landmarks moved.
  double lost_s = 20.0;
  int min_observations = 20;
  double lost_share = 0.2;

  /// Found: this share of the same number of observations agrees.
  double found_share = 0.5;

  /// Landmarks moved, and the pose is not wrong: of at least this number of pairs of failing
  /// landmarks, a smaller share than this keeps its distance.
  int min_pairs = 4;
  double min_pair_share = 0.6;
};

/// Keeps which of the landmarks seen last agree with the pose, and tells a lost vehicle from an old
/// map where nothing else does.
///
/// A landmark at an unknown place fails alone; when the pose is wrong, everything does. So a pose
/// counts as lost when for a while (HealthOptions) nearly everything seen agreed with none of its
/// modes and with no place that it was found to have moved to. With another pose at hand that
/// explains what fails, the vehicle is known to be lost earlier: DeclareLost(). It counts as found
/// again when enough sightings agree (`found_share`), of three landmarks or more.
///
/// Memory: as much as its constructor takes.
class HealthMonitor {
 public:
  explicit HealthMonitor(std::size_t groups, const HealthOptions& options = {})
      : options_(options), last_(groups) {}

  /// @param explained  By a mode of the group, or by a place that it is known to have moved to.
  /// @param nis        Of the mode, 2 dof; nothing where none explains.
  /// @param vague      What explains it does so because the pose is vague: that it fails later says
  ///                   nothing against a pose that has become exact.
  void Add(Stamp stamp, int group, bool explained, std::optional<double> nis, bool vague = false);

  /// Takes in the pairs of landmarks that fail of a scan. A wrong pose leaves distances as they
  /// are; landmarks that moved do not keep theirs.
  void AddPairs(Stamp stamp, const FailingPairs& pairs);

  /// Judges what was added.
  void Judge();

  /// The pose has been wrong since then: another explains what failed, or nobody knows it any more.
  void DeclareLost(Stamp since);

  bool lost() const { return lost_; }

  /// Lost by DeclareLost(): the pose is wrong, and not only in doubt.
  bool wrong() const { return lost_ && wrong_; }

  /// Set by Judge() if the map does not prove the pose: of the landmarks seen last, so few stand
  /// where it has them that no such number has moved at once. The numbers of these and the others.
  const std::optional<PoseSupport>& unproven() const { return unproven_; }

  /// Of the last observations, those from `since` on and not of `except` (-1: of all).
  PoseSupport Support(Stamp since, int except) const;

  /// Of all that it goes by.
  PoseSupport Support() const { return Support(Stamp::min(), -1); }

  /// Support().Confirms(), in constant time.
  bool Confirms() const;

  /// Support().Doubts(), in constant time.
  bool Doubts() const { return all_.Doubts(); }

  /// The distances of landmarks that fail show that these moved, and not that the pose is wrong.
  bool LandmarksMoved() const { return LandmarksMoved(tallies_.begin()); }

  /// Begin of the failures that made the pose lost. What was concluded since is not to be trusted.
  Stamp failing_since() const { return failing_since_; }

  /// The landmarks that agree so far have made the pose.
  void MarkStart();

  /// Landmarks by whether a mode explained their last observation, which was made since a time.
  struct AtModes {
    int yes = 0;
    int of_start = 0;  ///< They have made the pose.
    int no = 0;
  };
  AtModes CountAtModes(Stamp since) const;

  void Reset();

 private:
  struct LastSeen {
    Stamp stamp = Stamp::min();
    bool explained = false;
    bool at_mode = false;
    bool of_start = false;
    Stamp agreed = Stamp::min();  // When it was explained last.
  };

  // What was seen in one scan.
  struct Tally {
    Stamp stamp;
    int explained = 0;
    int failed = 0;
    double nis_sum = 0.0;
    int updates = 0;
    FailingPairs pairs;
  };
  using Tallies = boost::circular_buffer<Tally>;

  Tally& TallyAt(Stamp stamp);
  // The first scan of the least stretch up to now that is as long and tells as much; end() if there
  // is none yet.
  Tallies::const_iterator StretchBegin(double seconds, int observations) const;
  double ExplainedShare(Tallies::const_iterator begin) const;
  bool LandmarksMoved(Tallies::const_iterator begin) const;
  std::optional<PoseSupport> JudgeProof() const;

  static constexpr std::size_t kScans = 512;

  HealthOptions options_;
  std::vector<LastSeen> last_;  // By group.
  PoseSupport all_;             // Counts of last_, and nothing else.
  Tallies tallies_{kScans};     // Of scans in which something was seen.
  bool lost_ = false;
  bool wrong_ = false;
  std::optional<PoseSupport> unproven_;
  Stamp failing_since_;
};

}  // namespace shiftmap
