// SPDX-License-Identifier: Apache-2.0
#include "mapstore/maintenance/thin_ledger.h"

#include <Eigen/Core>
#include <algorithm>
#include <iterator>
#include <limits>
#include <optional>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "mapstore/map/map_snapshot.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/store/blob.h"
#include "mapstore/store/ledger_cursor.h"
#include "mapstore/store/ledger_view.h"

namespace shiftmap {
namespace {

constexpr double kSure = 10.0;          // [nat]
constexpr double kContradiction = 1.0;  // [nat]
constexpr double kMoved = 0.05;         // Probability.

// What a row says for a state: its log-likelihood less the largest of all others. [nat]
double MarginOf(const Eigen::VectorXd& log_likelihoods, Eigen::Index state) {
  double others = -std::numeric_limits<double>::infinity();
  for (Eigen::Index other = 0; other < log_likelihoods.size(); ++other) {
    if (other != state) others = std::max(others, log_likelihoods(other));
  }
  return log_likelihoods(state) - others;
}

// The rows of one landmark, in the order of time, as far as they say the same.
class Stretch {
 public:
  // Takes the next row, and adds those that it makes dispensable.
  void Add(const LedgerKey& row,
           std::int64_t vehicle,
           const Eigen::VectorXd& log_likelihoods,
           double max_gap_s,
           std::vector<LedgerKey>* dispensable) {
    const double margin = state_ ? MarginOf(log_likelihoods, *state_) : 0.0;
    if (state_ && margin >= kSure) {
      AddSure({row, vehicle}, max_gap_s, dispensable);
    } else if (state_ && margin + against_ > -kContradiction) {
      against_ += std::min(0.0, margin);
      between_.push_back(row);
    } else {
      *this = Stretch();
      Eigen::Index favoured = 0;
      log_likelihoods.maxCoeff(&favoured);
      if (MarginOf(log_likelihoods, favoured) < kSure) return;
      state_ = favoured;
      first_vehicle_ = vehicle;
      last_kept_ = row.begin;
    }
  }

 private:
  struct SureRow {
    LedgerKey row;
    std::int64_t vehicle = 0;
  };

  void AddSure(const SureRow& sure, double max_gap_s, std::vector<LedgerKey>* dispensable) {
    dispensable->insert(dispensable->end(), between_.begin(), between_.end());
    between_.clear();
    against_ = 0.0;
    if (!confirmed_ && sure.vehicle != first_vehicle_) {
      confirmed_ = true;
      Keep(sure.row);
      return;
    }
    // In seconds: stamps of a damaged store lie further apart than nanoseconds count.
    const double gap_s = ToSecondsSinceEpoch(sure.row.begin) - ToSecondsSinceEpoch(last_kept_);
    if (gap_s > max_gap_s && last_) Keep(last_->row);
    if (!last_) {
      last_ = sure;
      return;
    }
    // The last row of each of the last two vehicles.
    std::optional<SureRow>& superseded = last_->vehicle == sure.vehicle ? last_ : last_of_another_;
    if (superseded) dispensable->push_back(superseded->row);
    if (last_->vehicle != sure.vehicle) last_of_another_ = last_;
    last_ = sure;
  }

  // A row that stays, and the last ones before it with it.
  void Keep(const LedgerKey& row) {
    last_kept_ = row.begin;
    last_.reset();
    last_of_another_.reset();
  }

  std::optional<Eigen::Index> state_;
  std::int64_t first_vehicle_ = 0;
  bool confirmed_ = false;  // By another vehicle.
  Stamp last_kept_;
  std::vector<LedgerKey> between_;  // Since the last sure row,
  double against_ = 0.0;            // and what they say against the state. [nat]
  std::optional<SureRow> last_;
  std::optional<SureRow> last_of_another_;
};

// A group of the map, and the longest gap that may be made between its rows.
struct Group {
  const LandmarkGroup* group = nullptr;
  double max_gap_s = 0.0;
  Stretch stretch;
};

std::unordered_map<std::string_view, Group> MakeGroups(const MapContent& content) {
  constexpr double kLongestS = 1e8;
  std::unordered_map<std::string_view, Group> groups;
  for (const LandmarkGroup& group : content.groups) {
    const double rate = group.chain.leave_rate_per_s();
    const double gap_s = rate * kLongestS > kMoved ? kMoved / rate : kLongestS;
    groups[group.signature.text()] = {&group, gap_s, {}};
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
  std::vector<LedgerKey> dispensable;
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
      group->second.stretch.Add(
          KeyOf(*row), vehicle->key, log_likelihoods, group->second.max_gap_s, &dispensable);
    }
  }
  SHIFTMAP_RETURN_IF_ERROR(DeleteLedgerRows(database, area_id, dispensable));
  return std::ssize(dispensable);
}

}  // namespace shiftmap
