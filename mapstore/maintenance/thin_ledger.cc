// SPDX-License-Identifier: Apache-2.0
#include "mapstore/maintenance/thin_ledger.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <unordered_map>
#include <utility>
#include <vector>

#include "mapstore/map/map_snapshot.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/store/blob.h"
#include "mapstore/store/ledger_cursor.h"
#include "mapstore/store/ledger_view.h"
#include "mapstore/store/summary_rows.h"

namespace shiftmap {
namespace {

constexpr double kSure = 10.0;          // [nat]
constexpr double kContradiction = 1.0;  // [nat]
constexpr double kForgotten = 0.05;     // Probability of a move, in a gap of a summary.
constexpr double kMoved = 0.005;        // Probability, in a step of a summary.

// What a row says for a state: its log-likelihood less the largest of all others. [nat]
double MarginOf(const Eigen::VectorXd& log_likelihoods, Eigen::Index state) {
  double others = -std::numeric_limits<double>::infinity();
  for (Eigen::Index other = 0; other < log_likelihoods.size(); ++other) {
    if (other != state) others = std::max(others, log_likelihoods(other));
  }
  return log_likelihoods(state) - others;
}

// A row that is sure, and what it stands for.
struct SureRow {
  LedgerKey row;
  std::int64_t vehicle = 0;
  double margin = 0.0;  // [nat]
  std::string log_likelihoods;
  LedgerSummary summary;
};

// The rows that are deleted, and the summaries that replace them.
struct ThinnedRows {
  std::vector<LedgerKey> gone;

  struct Summary {
    LedgerKey row;
    std::int64_t observations = 0;
    std::string log_likelihoods;
    LedgerSummary summary;
  };
  std::vector<Summary> summaries;
};

// Sure rows of one stretch that one row will stand for.
class SummedRows {
 public:
  // @param sure  Of several vehicles, hence not strictly in the order of time.
  void Add(const SureRow& sure) {
    rows_.push_back(sure.row);
    visits_ += sure.summary.visits;
    // In seconds: stamps of a damaged store lie further apart than nanoseconds count.
    parts_.push_back(
        {ToSecondsSinceEpoch(sure.row.begin), ToSecondsSinceEpoch(sure.row.end), sure.summary});
    const bool first = rows_.size() == 1;
    end_ = first ? sure.row.end : std::max(end_, sure.row.end);
    if (first || sure.margin < least_.margin) least_ = sure;
  }

  // From the last of them to another one. [s]
  double GapTo(const SureRow& sure) const {
    if (rows_.empty()) return 0.0;
    return ToSecondsSinceEpoch(sure.row.begin) - ToSecondsSinceEpoch(end_);
  }

  // @param seen  Whether the state is one that the landmark is seen at.
  void Finish(double rate_per_s, bool seen, ThinnedRows* thinned) const {
    if (rows_.size() < 2) return;
    const Gaps gaps = CountGaps();
    const double equivalent =
        gaps.squares_s2 > 0.0 ? gaps.sum_s * gaps.sum_s / gaps.squares_s2 : 1.0;
    const double needed = std::ceil(rate_per_s * gaps.sum_s / kMoved);
    const double most = static_cast<double>(visits_ - 1);
    const double steps = std::clamp(std::round(std::min(equivalent, needed)), 1.0, most);
    ThinnedRows::Summary sum;
    // Of the report with the first of them: no report has rows from before its first visit.
    sum.row = *std::min_element(
        rows_.begin(), rows_.end(), [](const auto& a, const auto& b) { return a.begin < b.begin; });
    sum.row.end = end_;
    sum.observations = seen ? visits_ : 0;
    sum.log_likelihoods = least_.log_likelihoods;
    sum.summary = {visits_, static_cast<std::int64_t>(steps), gaps.sum_s};
    thinned->summaries.push_back(std::move(sum));
    thinned->gone.insert(thinned->gone.end(), rows_.begin(), rows_.end());
  }

 private:
  struct Part {
    double begin_s = 0.0;
    double end_s = 0.0;
    LedgerSummary summary;
  };

  struct Gaps {
    double sum_s = 0.0;
    double squares_s2 = 0.0;
  };

  // The gaps between the rows and within summaries, each time once.
  Gaps CountGaps() const {
    std::vector<Part> parts = parts_;
    std::sort(parts.begin(), parts.end(), [](const Part& a, const Part& b) {
      return std::tie(a.begin_s, a.end_s) < std::tie(b.begin_s, b.end_s);
    });
    Gaps gaps;
    double end_s = parts.front().begin_s;
    for (const Part& part : parts) {
      const double gap_s = std::max(0.0, part.begin_s - end_s);
      gaps.sum_s += gap_s;
      gaps.squares_s2 += gap_s * gap_s;
      const double new_s = part.end_s - std::max(part.begin_s, end_s);
      if (new_s > 0.0 && part.summary.steps > 0) {
        const double inner_s = part.summary.gap_s * new_s / (part.end_s - part.begin_s);
        gaps.sum_s += inner_s;
        gaps.squares_s2 += inner_s * part.summary.gap_s / static_cast<double>(part.summary.steps);
      }
      end_s = std::max(end_s, part.end_s);
    }
    return gaps;
  }

  std::vector<LedgerKey> rows_;
  std::vector<Part> parts_;
  SureRow least_;
  Stamp end_;
  std::int64_t visits_ = 0;
};

// The rows of one landmark, in the order of time, as far as they say the same.
class Stretch {
 public:
  explicit Stretch(double rate_per_s) : rate_per_s_(rate_per_s) {}

  // Takes the next row, and adds what becomes of others by it.
  void Add(SureRow row, const Eigen::VectorXd& log_likelihoods, ThinnedRows* thinned) {
    row.margin = state_ ? MarginOf(log_likelihoods, *state_) : 0.0;
    if (state_ && row.margin >= kSure) {
      AddSure(std::move(row), thinned);
    } else if (state_ && row.margin + against_ > -kContradiction) {
      against_ += std::min(0.0, row.margin);
      between_.push_back(row.row);
    } else {
      Finish(thinned);
      *this = Stretch(rate_per_s_);
      Eigen::Index favoured = 0;
      log_likelihoods.maxCoeff(&favoured);
      if (MarginOf(log_likelihoods, favoured) < kSure) return;
      state_ = favoured;
      first_vehicle_ = row.vehicle;
    }
  }

  void Finish(ThinnedRows* thinned) const {
    if (state_) summed_.Finish(rate_per_s_, *state_ > 0, thinned);
  }

 private:
  void AddSure(SureRow sure, ThinnedRows* thinned) {
    thinned->gone.insert(thinned->gone.end(), between_.begin(), between_.end());
    between_.clear();
    against_ = 0.0;
    if (!confirmed_ && sure.vehicle != first_vehicle_) {
      confirmed_ = true;
      last_.reset();
      last_of_another_.reset();
      return;
    }
    if (last_) {
      // The last row of each of the last two vehicles.
      const bool same = last_->vehicle == sure.vehicle;
      const std::optional<SureRow>& superseded = same ? last_ : last_of_another_;
      if (superseded) SumUp(*superseded, thinned);
      if (!same) last_of_another_ = std::move(last_);
    }
    last_ = std::move(sure);
  }

  // Through a long gap the filter forgets, and a summary would not.
  void SumUp(const SureRow& sure, ThinnedRows* thinned) {
    if (rate_per_s_ * summed_.GapTo(sure) > kForgotten) {
      Finish(thinned);
      summed_ = SummedRows();
    }
    summed_.Add(sure);
  }

  double rate_per_s_;
  std::optional<Eigen::Index> state_;
  std::int64_t first_vehicle_ = 0;
  bool confirmed_ = false;          // By another vehicle.
  std::vector<LedgerKey> between_;  // Since the last sure row,
  double against_ = 0.0;            // and what they say against the state. [nat]
  std::optional<SureRow> last_;
  std::optional<SureRow> last_of_another_;
  SummedRows summed_;
};

// A group of the map.
struct Group {
  const LandmarkGroup* group = nullptr;
  Stretch stretch;
};

std::unordered_map<std::string_view, Group> MakeGroups(const MapContent& content) {
  std::unordered_map<std::string_view, Group> groups;
  for (const LandmarkGroup& group : content.groups) {
    groups.try_emplace(group.signature.text(),
                       Group{&group, Stretch(group.chain.leave_rate_per_s())});
  }
  return groups;
}

}  // namespace

StatusOr<std::int64_t> ThinLedger(Database& database,
                                  std::int64_t area_id,
                                  const VersionRow& version,
                                  Stamp before,
                                  const std::string& owner) {
  SHIFTMAP_ASSIGN_OR_RETURN(const MapContent content, ReadContent(database, version, owner));
  std::unordered_map<std::string_view, Group> groups = MakeGroups(content);
  SHIFTMAP_ASSIGN_OR_RETURN(const auto summaries, ReadSummaries(database, area_id));
  ThinnedRows thinned;
  {
    LedgerView view(database, version);
    SHIFTMAP_ASSIGN_OR_RETURN(LedgerCursor cursor,
                              LedgerCursor::Make(database, area_id, Stamp::min(), before, before));
    std::vector<VisitEvidence::ModeLogLikelihood> modes;
    Eigen::VectorXd log_likelihoods;
    for (;;) {
      SHIFTMAP_ASSIGN_OR_RETURN(const LedgerRow* const row, cursor.Next());
      if (row == nullptr) break;
      SHIFTMAP_ASSIGN_OR_RETURN(const std::string_view name,
                                view.NameOf(row->signature, row->version_id));
      const auto group = groups.find(name);
      if (group == groups.end()) continue;
      SHIFTMAP_ASSIGN_OR_RETURN(const bool counts, view.Counts(*row));
      if (!counts) continue;
      if (!UnpackLogLikelihoods(row->log_likelihoods, &modes)) {
        return DataLoss("{}: evidence of '{}' at {:.6f} s is damaged",
                        owner,
                        row->signature,
                        ToSecondsSinceEpoch(row->begin));
      }
      SHIFTMAP_RETURN_IF_ERROR(view.Split(name, row->report_id, row->run_id, &modes));
      if (!StateLogLikelihoods(*group->second.group, modes, &log_likelihoods)) continue;
      SHIFTMAP_ASSIGN_OR_RETURN(const LedgerVehicle* const vehicle,
                                view.VehicleOf(row->report_id, row->run_id));
      SureRow sure{KeyOf(*row), vehicle->key, 0.0, std::string(row->log_likelihoods), {}};
      const auto summary = summaries.find(SummaryKeyOf(sure.row));
      if (summary != summaries.end()) sure.summary = summary->second;
      group->second.stretch.Add(std::move(sure), log_likelihoods, &thinned);
    }
  }
  for (const LandmarkGroup& group : content.groups) {
    groups.at(group.signature.text()).stretch.Finish(&thinned);
  }
  SHIFTMAP_RETURN_IF_ERROR(DeleteLedgerRows(database, area_id, thinned.gone));
  SHIFTMAP_RETURN_IF_ERROR(DeleteOrphanedSummaries(database, area_id));
  for (const ThinnedRows::Summary& sum : thinned.summaries) {
    SHIFTMAP_RETURN_IF_ERROR(InsertSummary(
        database, area_id, sum.row, sum.observations, sum.log_likelihoods, sum.summary));
  }
  return std::ssize(thinned.gone) - std::ssize(thinned.summaries);
}

}  // namespace shiftmap
