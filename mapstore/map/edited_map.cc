// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/edited_map.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "mapstore/core/inert_text.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/frame_change.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/map/mode_split.h"

namespace shiftmap {
namespace {

// A group by its name.
StatusOr<std::size_t> FindGroup(const Signature& name, const MapContent& content) {
  const auto found = std::lower_bound(
      content.groups.begin(),
      content.groups.end(),
      name,
      [](const LandmarkGroup& group, const Signature& of) { return group.signature < of; });
  if (found == content.groups.end() || found->signature != name) {
    return NotFound("no landmark '{}'", InertLine(name.text()));
  }
  return static_cast<std::size_t>(found - content.groups.begin());
}

StatusOr<std::size_t> FindMode(const LandmarkGroup& group, ModeNumber number) {
  const int state = group.StateOf(number);
  if (state >= 1) return static_cast<std::size_t>(state) - 1;
  return NotFound("landmark '{}': no mode {}", InertLine(group.signature.text()), number.value());
}

// A content with, of every mode, its row in a joint covariance, while groups and modes come and go.
class Rows {
 public:
  explicit Rows(const MapContent& content) : cov_(content.covariance) {
    int row = 0;
    for (const LandmarkGroup& group : content.groups) {
      std::vector<int>& of_group = rows_.emplace_back();
      for (std::size_t i = 0; i < group.modes.size(); ++i) of_group.push_back(row++);
    }
  }

  std::vector<std::vector<int>>& groups() { return rows_; }
  std::vector<int>& operator[](std::size_t group) { return rows_[group]; }

  // Gives the content the joint covariance of the rows that are left. A mode with row kNone has its
  // marginal and no correlation.
  void Restore(MapContent* content) const {
    std::vector<int> place(static_cast<std::size_t>(cov_.size()), kNone);
    std::vector<Eigen::Matrix2d> diagonal;
    for (std::size_t g = 0; g < rows_.size(); ++g) {
      for (std::size_t i = 0; i < rows_[g].size(); ++i) {
        if (rows_[g][i] != kNone) {
          place[static_cast<std::size_t>(rows_[g][i])] = static_cast<int>(diagonal.size());
        }
        diagonal.push_back(content->groups[g].modes[i].cov_p_map_landmark);
      }
    }
    std::vector<JointCovariance::CrossBlock> cross;
    for (JointCovariance::CrossBlock block : cov_.cross_blocks()) {
      block.row = place[static_cast<std::size_t>(block.row)];
      block.column = place[static_cast<std::size_t>(block.column)];
      if (block.row == kNone || block.column == kNone) continue;
      if (block.row > block.column) {
        std::swap(block.row, block.column);
        block.value.transposeInPlace();
      }
      cross.push_back(block);
    }
    content->covariance = JointCovariance(std::move(diagonal), std::move(cross));
  }

  static constexpr int kNone = -1;

 private:
  JointCovariance cov_;
  std::vector<std::vector<int>> rows_;
};

// The chain of a group that has another number of modes, with the same mean leave rate.
void ResetChain(LandmarkGroup* group) {
  group->chain =
      ModeChain::Uniform(static_cast<int>(group->modes.size()), group->chain.leave_rate_per_s());
}

std::vector<StatedMode> StatedOf(const LandmarkGroup& group) {
  std::vector<StatedMode> stated;
  for (int state = 0; state < group.chain.states(); ++state) {
    stated.push_back({group.NumberOf(state), group.probabilities(state)});
  }
  return stated;
}

// Probabilities of a group that has other modes now.
void CarryProbabilities(const LandmarkGroup& before, LandmarkGroup* group) {
  group->probabilities = CarriedProbabilities(*group, StatedOf(before));
  const double sum = group->probabilities.sum();
  if (sum > 0.0) {
    group->probabilities /= sum;
  } else {
    group->probabilities = group->chain.stationary();
  }
}

// Adds a number that no mode gets again.
void Retire(ModeNumber number, ModeNumber into, LandmarkGroup* group) {
  const auto place = std::find_if(group->merged.begin(),
                                  group->merged.end(),
                                  [&](const MergedMode& merged) { return number < merged.number; });
  group->merged.insert(place, {number, into});
}

// Takes a mode out of a group. Its number stays with `into`.
void RemoveMode(std::size_t g, std::size_t mode, ModeNumber into, MapContent* content) {
  LandmarkGroup& group = content->groups[g];
  const LandmarkGroup before = group;
  const ModeNumber number = group.modes[mode].number;
  Rows rows(*content);
  rows[g].erase(rows[g].begin() + static_cast<std::ptrdiff_t>(mode));
  group.modes.erase(group.modes.begin() + static_cast<std::ptrdiff_t>(mode));
  for (MergedMode& merged : group.merged) {
    if (merged.into == number) merged.into = into;
  }
  Retire(number, into, &group);
  ResetChain(&group);
  CarryProbabilities(before, &group);
  rows.Restore(content);
}

// Adds a mode to a group, where it goes by its number.
void AddMode(std::size_t g, const Mode& mode, MapContent* content) {
  LandmarkGroup& group = content->groups[g];
  const LandmarkGroup before = group;
  Rows rows(*content);
  const auto place = std::find_if(group.modes.begin(), group.modes.end(), [&](const Mode& other) {
    return mode.number < other.number;
  });
  rows[g].insert(rows[g].begin() + (place - group.modes.begin()), Rows::kNone);
  group.modes.insert(place, mode);
  ResetChain(&group);
  CarryProbabilities(before, &group);
  rows.Restore(content);
}

// A chain with the rhythm of another one, the rates of each of its phases changed.
template <class Change>
StatusOr<ModeChain> WithRhythmOf(const ModeChain& from, Change change, const ModeChain& chain) {
  if (from.rhythm() == nullptr) return chain;
  std::vector<Eigen::MatrixXd> phases;
  for (const Eigen::MatrixXd& rates : from.rhythm()->rate_matrices()) {
    phases.push_back(change(rates));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(ChainRhythm rhythm,
                            ChainRhythm::Make(from.rhythm()->calendar().period, std::move(phases)));
  return chain.WithRhythm(std::move(rhythm));
}

// The rates of a chain in which two states are one: rates into them add up, rates out of them are
// the mean by the time spent there.
// @param pi  The share of time in each state.
Eigen::MatrixXd LumpedRates(Eigen::MatrixXd rates, const Eigen::VectorXd& pi, int gone, int into) {
  const double both = pi(gone) + pi(into);
  const double share = both > 0.0 ? pi(gone) / both : 0.5;
  rates.row(into) = share * rates.row(gone) + (1.0 - share) * rates.row(into);
  rates.col(into) += rates.col(gone);
  const auto states = static_cast<int>(rates.rows());
  Eigen::MatrixXd lumped(states - 1, states - 1);
  for (int i = 0, row = 0; i < states; ++i) {
    if (i == gone) continue;
    for (int k = 0, column = 0; k < states; ++k) {
      if (k != gone) lumped(row, column++) = rates(i, k);
    }
    ++row;
  }
  lumped.diagonal().setZero();
  lumped.diagonal() = -lumped.rowwise().sum();
  return lumped;
}

// The chain in which two states are one.
ModeChain Lumped(const ModeChain& chain, int gone, int into) {
  const Eigen::VectorXd& pi = chain.stationary();
  ModeChain result = ModeChain::Uniform(chain.states() - 2, chain.leave_rate_per_s());
  if (!chain.uniform()) {
    StatusOr<ModeChain> lumped =
        ModeChain::FromRates(LumpedRates(chain.rate_matrix(), pi, gone, into));
    if (lumped.ok()) result = *std::move(lumped);
  }
  const StatusOr<ModeChain> with_rhythm = WithRhythmOf(
      chain,
      [&](const Eigen::MatrixXd& rates) { return LumpedRates(rates, pi, gone, into); },
      result);
  return with_rhythm.ok() ? *with_rhythm : result;
}

Status ApplyPosition(const MapEdit& edit, std::size_t g, MapContent* content) {
  LandmarkGroup& group = content->groups[g];
  SHIFTMAP_ASSIGN_OR_RETURN(const std::size_t i, FindMode(group, edit.mode));
  Rows rows(*content);
  rows[g][i] = Rows::kNone;
  group.modes[i].p_map_landmark = edit.p_map_landmark;
  group.modes[i].cov_p_map_landmark = edit.sd_m * edit.sd_m * Eigen::Matrix2d::Identity();
  rows.Restore(content);
  return OkStatus();
}

Status ApplyNewMode(const MapEdit& edit, std::size_t g, MapContent* content) {
  const LandmarkGroup& group = content->groups[g];
  if (group.CarriedStateOf(edit.mode) >= 0) {
    return InvalidArgument(
        "landmark '{}': has had a mode {}", InertLine(group.signature.text()), edit.mode.value());
  }
  Mode mode;
  mode.number = edit.mode;
  mode.p_map_landmark = edit.p_map_landmark;
  mode.cov_p_map_landmark = edit.sd_m * edit.sd_m * Eigen::Matrix2d::Identity();
  AddMode(g, mode, content);
  return OkStatus();
}

// Each place has half of the mode's probability.
Status ApplySplit(const MapEdit& edit, std::size_t g, MapContent* content) {
  SHIFTMAP_RETURN_IF_ERROR(ApplyPosition(edit, g, content));
  LandmarkGroup& group = content->groups[g];
  if (group.CarriedStateOf(edit.into) >= 0) {
    return InvalidArgument(
        "landmark '{}': has had a mode {}", InertLine(group.signature.text()), edit.into.value());
  }
  const LandmarkGroup before = group;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::size_t i, FindMode(before, edit.mode));
  Mode second = before.modes[i];
  second.number = edit.into;
  second.p_map_landmark = edit.p_map_second;
  AddMode(g, second, content);
  group.probabilities = CarriedProbabilities(
      group, SplitStatement(before, {edit.mode, edit.into, {}, {}}, StatedOf(before)));
  return OkStatus();
}

Status ApplyRetire(std::size_t g, MapContent* content) {
  if (content->groups.size() == 1) {
    return InvalidArgument("landmark '{}': is the last one of the map",
                           InertLine(content->groups[g].signature.text()));
  }
  Rows rows(*content);
  rows.groups().erase(rows.groups().begin() + static_cast<std::ptrdiff_t>(g));
  content->groups.erase(content->groups.begin() + static_cast<std::ptrdiff_t>(g));
  rows.Restore(content);
  return OkStatus();
}

// @param g  Renamed, it goes where its name is in order.
Status Rename(std::size_t g, const Signature& name, MapContent* content) {
  if (FindGroup(name, *content).ok()) {
    return InvalidArgument("'{}': is another landmark of the map", InertLine(name.text()));
  }
  Rows rows(*content);
  LandmarkGroup group = std::move(content->groups[g]);
  std::vector<int> of_group = std::move(rows[g]);
  group.signature = name;
  content->groups.erase(content->groups.begin() + static_cast<std::ptrdiff_t>(g));
  rows.groups().erase(rows.groups().begin() + static_cast<std::ptrdiff_t>(g));
  const auto place =
      std::find_if(content->groups.begin(), content->groups.end(), [&](const LandmarkGroup& other) {
        return name < other.signature;
      });
  rows.groups().insert(rows.groups().begin() + (place - content->groups.begin()),
                       std::move(of_group));
  content->groups.insert(place, std::move(group));
  rows.Restore(content);
  return OkStatus();
}

Status ApplyMerge(const MapEdit& edit, std::size_t g, MapContent* content) {
  LandmarkGroup& group = content->groups[g];
  SHIFTMAP_ASSIGN_OR_RETURN(const std::size_t gone, FindMode(group, edit.mode));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::size_t into, FindMode(group, edit.into));
  if (gone == into) {
    return InvalidArgument("mode {}: cannot be part of itself", edit.mode.value());
  }
  group.modes[into].last_seen = std::max(group.modes[into].last_seen, group.modes[gone].last_seen);
  const ModeChain chain =
      Lumped(group.chain, static_cast<int>(gone) + 1, static_cast<int>(into) + 1);
  RemoveMode(g, gone, edit.into, content);
  content->groups[g].chain = chain;
  return OkStatus();
}

// One step of the rate fit: the chain jumps as often as it did in the time of the evidence, and as
// the statement says in the statement's.
Status ApplyRate(const MapEdit& edit, LandmarkGroup* group) {
  const double old_rate = group->chain.leave_rate_per_s();
  const double rate = (old_rate * edit.evidence_s + edit.weight) /
                      (edit.evidence_s + edit.weight / edit.rate_per_s);
  const ModeChain old = group->chain;
  if (!(old_rate > 0.0)) {
    group->chain = ModeChain::Uniform(old.states() - 1, rate);
    return OkStatus();
  }
  const double factor = rate / old_rate;
  ModeChain scaled = ModeChain::Uniform(old.states() - 1, rate);
  if (!old.uniform()) {
    SHIFTMAP_ASSIGN_OR_RETURN(scaled, ModeChain::FromRates(old.rate_matrix() * factor));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(
      group->chain,
      WithRhythmOf(
          old, [factor](const auto& rates) { return rates * factor; }, scaled));
  return OkStatus();
}

Status ApplyCalibration(const MapEdit& edit,
                        const std::optional<VehicleCalibration>& kept,
                        MapContent* content) {
  const auto found = std::find_if(
      content->vehicles.begin(), content->vehicles.end(), [&](const VehicleCalibration& vehicle) {
        return vehicle.vehicle == edit.vehicle;
      });
  if (found == content->vehicles.end()) {
    return NotFound("no calibration of a vehicle '{}'", InertLine(edit.vehicle));
  }
  if (found->stamp < edit.since) {
    return NotFound("vehicle '{}': nothing is known of it since then", InertLine(edit.vehicle));
  }
  if (kept) {
    *found = *kept;
  } else {
    content->vehicles.erase(found);
  }
  return OkStatus();
}

// The mode of a group nearest to a position, if it is clearly so.
StatusOr<ModeNumber> NearestMode(const LandmarkGroup& group, const Eigen::Vector2d& p) {
  constexpr double kClearly = 2.0;
  std::vector<std::pair<double, ModeNumber>> modes;
  for (const Mode& mode : group.modes) {
    modes.emplace_back((mode.p_map_landmark - p).norm(), mode.number);
  }
  std::sort(modes.begin(), modes.end());
  if (modes.empty()) {
    return NotFound("landmark '{}': no mode", InertLine(group.signature.text()));
  }
  if (modes.size() > 1 && modes[1].first < kClearly * modes[0].first) {
    return InvalidArgument(
        "landmark '{}': mode {} is {:.3f} m away and mode {} is {:.3f} m: "
        "expected the mode to be named",
        InertLine(group.signature.text()),
        modes[0].second.value(),
        modes[0].first,
        modes[1].second.value(),
        modes[1].first);
  }
  return modes[0].second;
}

// Gives a vehicle back what was known of it, if nothing was learned since.
void RestoreVehicle(const MapEdit& edit, const MapContent& before, MapContent* content) {
  const auto by_name = [](const VehicleCalibration& vehicle, const std::string& name) {
    return vehicle.vehicle < name;
  };
  const auto known =
      std::lower_bound(before.vehicles.begin(), before.vehicles.end(), edit.vehicle, by_name);
  if (known == before.vehicles.end() || known->vehicle != edit.vehicle) return;
  const auto now =
      std::lower_bound(content->vehicles.begin(), content->vehicles.end(), edit.vehicle, by_name);
  if (now == content->vehicles.end() || now->vehicle != edit.vehicle) {
    content->vehicles.insert(now, *known);
  } else if (now->stamp < edit.since) {
    *now = *known;
  }
}

// Adds a group that was retired.
Status RestoreGroup(LandmarkGroup group, const Signature& name, MapContent* content) {
  if (FindGroup(name, *content).ok()) {
    return InvalidArgument("'{}': is another landmark of the map", InertLine(name.text()));
  }
  group.signature = name;
  Rows rows(*content);
  const auto place =
      std::find_if(content->groups.begin(), content->groups.end(), [&](const LandmarkGroup& other) {
        return name < other.signature;
      });
  rows.groups().insert(rows.groups().begin() + (place - content->groups.begin()),
                       std::vector<int>(group.modes.size(), Rows::kNone));
  content->groups.insert(place, std::move(group));
  rows.Restore(content);
  return OkStatus();
}

// Where a state of a group is from another one of it: two maps may know that better than where
// either is.
struct Offset {
  Eigen::Vector2d p = Eigen::Vector2d::Zero();
  Eigen::Matrix2d cov = Eigen::Matrix2d::Zero();
};

Offset OffsetOf(std::size_t g, std::size_t from, std::size_t to, const MapContent& content) {
  int first = 0;
  for (std::size_t i = 0; i < g; ++i) first += static_cast<int>(content.groups[i].modes.size());
  const int a = first + static_cast<int>(from);
  const int b = first + static_cast<int>(to);
  const std::vector<Mode>& modes = content.groups[g].modes;
  const Eigen::Matrix2d cross = content.covariance.Block(a, b);
  return {
      modes[to].p_map_landmark - modes[from].p_map_landmark,
      content.covariance.Block(a, a) + content.covariance.Block(b, b) - cross - cross.transpose()};
}

// The mode that builds since a merge made at the place of the mode that went, or nothing.
// @param was, g  The landmark before the merge, and now.
std::optional<ModeNumber> FindMadeSince(const MapEdit& merge,
                                        const MapContent& before,
                                        std::size_t was,
                                        const MapContent& content,
                                        std::size_t g) {
  // As builds tell modes apart.
  constexpr double kFloorM = 0.07;
  constexpr double kProbability = 0.99;
  const LandmarkGroup& old = before.groups[was];
  const LandmarkGroup& group = content.groups[g];
  const int gone = old.StateOf(merge.mode);
  const int old_into = old.StateOf(merge.into);
  const int into = group.CarriedStateOf(merge.into);
  if (gone < 1 || old_into < 1 || into < 1) return std::nullopt;
  const auto index = [](int state) { return static_cast<std::size_t>(state) - 1; };
  const Offset then = OffsetOf(was, index(old_into), index(gone), before);
  for (std::size_t i = 0; i < group.modes.size(); ++i) {
    if (group.modes[i].number < old.NextNumber() || i == index(into)) continue;
    const Offset now = OffsetOf(g, index(into), i, content);
    const Eigen::Matrix2d cov =
        then.cov + now.cov + 2.0 * kFloorM * kFloorM * Eigen::Matrix2d::Identity();
    if (SquaredMahalanobis(now.p - then.p, cov) <= ChiSquareQuantile(kProbability, 2)) {
      return group.modes[i].number;
    }
  }
  return std::nullopt;
}

// Adds a mode that was merged. Where builds made one at its place since, that one stands for it.
// @param before, was  The map before the merge, and the landmark in it.
Status RestoreMode(const MapEdit& merge,
                   const MapContent& before,
                   std::size_t was,
                   std::size_t g,
                   MapContent* content) {
  const LandmarkGroup& old = before.groups[was];
  SHIFTMAP_ASSIGN_OR_RETURN(const std::size_t mode, FindMode(old, merge.mode));
  LandmarkGroup& group = content->groups[g];
  const std::optional<ModeNumber> made = FindMadeSince(merge, before, was, *content, g);
  std::erase_if(group.merged,
                [&](const MergedMode& merged) { return merged.number == merge.mode; });
  for (MergedMode& merged : group.merged) {
    const bool of_mode =
        std::any_of(old.merged.begin(), old.merged.end(), [&](const MergedMode& other) {
          return other.number == merged.number && other.into == merge.mode;
        });
    if (of_mode) merged.into = made.value_or(merge.mode);
  }
  if (made) {
    Retire(merge.mode, *made, &group);
  } else {
    AddMode(g, old.modes[mode], content);
  }
  return OkStatus();
}

}  // namespace

std::vector<ControlPoint> ControlPointsOf(const std::vector<MapEdit>& held) {
  const LandmarkNames names(held);
  std::vector<ControlPoint> points;
  for (const MapEdit& edit : held) {
    const bool merged = std::any_of(held.begin(), held.end(), [&](const MapEdit& other) {
      return other.kind == EditKind::kMerge && other.landmark == edit.landmark &&
             other.mode == edit.mode;
    });
    if (edit.kind != EditKind::kControl || merged) continue;
    points.push_back({names.Name(edit.landmark), edit.mode, edit.p_map_landmark, edit.sd_m});
  }
  return points;
}

EditedMap::EditedMap(MapContent content, std::vector<MapEdit> held)
    : content_(std::move(content)), held_(std::move(held)), names_(held_) {}

const LandmarkGroup* EditedMap::GroupOf(const MapEdit& edit) const {
  const StatusOr<std::size_t> g = FindGroup(names_.Name(edit.landmark), content_);
  return g.ok() ? &content_.groups[*g] : nullptr;
}

Status EditedMap::Complete(MapEdit* edit) const {
  if (edit->kind == EditKind::kCalibration) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::size_t g, FindGroup(names_.Name(edit->landmark), content_));
  const LandmarkGroup& group = content_.groups[g];
  if (edit->kind == EditKind::kNewMode) edit->mode = group.NextNumber();
  if (edit->kind == EditKind::kSplit) edit->into = group.NextNumber();
  if (edit->kind != EditKind::kControl || edit->mode != kAbsent) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(edit->mode, NearestMode(group, edit->p_map_landmark));
  return OkStatus();
}

Status EditedMap::Apply(const MapEdit& edit, const std::optional<VehicleCalibration>& kept) {
  SHIFTMAP_RETURN_IF_ERROR(ApplyTo(edit, kept));
  held_.push_back(edit);
  names_.Add(edit);
  if (edit.kind == EditKind::kControl) {
    const std::vector<ControlPoint> points = ControlPointsOf(held_);
    HoldControlPoints(points, points.size() - 1, &content_);
  }
  return OkStatus();
}

Status EditedMap::CheckPointsWith(const MapEdit& control) const {
  std::vector<MapEdit> held = held_;
  held.push_back(control);
  return CheckControlPoints(ControlPointsOf(held), content_);
}

Status EditedMap::ApplyTo(const MapEdit& edit, const std::optional<VehicleCalibration>& kept) {
  if (edit.kind == EditKind::kCalibration) return ApplyCalibration(edit, kept, &content_);
  SHIFTMAP_ASSIGN_OR_RETURN(const std::size_t g, FindGroup(names_.Name(edit.landmark), content_));
  switch (edit.kind) {
    case EditKind::kPosition:
      return ApplyPosition(edit, g, &content_);
    case EditKind::kNewMode:
      return ApplyNewMode(edit, g, &content_);
    case EditKind::kControl:
      return FindMode(content_.groups[g], edit.mode).status();
    case EditKind::kRetire:
      return ApplyRetire(g, &content_);
    case EditKind::kRename:
      return Rename(g, edit.new_name, &content_);
    case EditKind::kMerge:
      return ApplyMerge(edit, g, &content_);
    case EditKind::kSplit:
      return ApplySplit(edit, g, &content_);
    case EditKind::kRate:
      return ApplyRate(edit, &content_.groups[g]);
    case EditKind::kCalibration:
      break;
  }
  return OkStatus();
}

void EditedMap::Reserve(const MapEdit& taken_back) {
  const StatusOr<std::size_t> g = FindGroup(names_.Name(taken_back.landmark), content_);
  if (!g.ok()) return;
  LandmarkGroup& group = content_.groups[*g];
  const bool split = taken_back.kind == EditKind::kSplit;
  const ModeNumber added = split ? taken_back.into : taken_back.mode;
  if (group.CarriedStateOf(added) >= 0) return;
  const int state = split ? group.CarriedStateOf(taken_back.mode) : 0;
  Retire(added, state >= 0 ? group.NumberOf(state) : kAbsent, &group);
}

bool EditedMap::IsReversible(const MapEdit& edit) const {
  switch (edit.kind) {
    case EditKind::kRetire:
    case EditKind::kRename:
    case EditKind::kMerge:
    case EditKind::kCalibration:
      return true;
    case EditKind::kNewMode: {
      const LandmarkGroup* const group = GroupOf(edit);
      if (group == nullptr) return true;
      const int state = group->StateOf(edit.mode);
      return state >= 1 && group->modes[static_cast<std::size_t>(state) - 1].last_seen == Stamp();
    }
    case EditKind::kPosition:
    case EditKind::kControl:
    case EditKind::kSplit:
    case EditKind::kRate:
      return false;
  }
  return false;
}

// Control points may have moved the frame since.
EditedMap EditedMap::InFrameOf(const EditedMap& later) const {
  EditedMap moved = *this;
  const auto T_new_old = CarryMap(content_, names_, later.content_, later.names_).moved;
  if (T_new_old) MoveContent(*T_new_old, &moved.content_);
  return moved;
}

Status EditedMap::Reverse(const MapEdit& edit, const EditedMap& before) {
  std::erase_if(held_, [&](const MapEdit& other) { return other.id == edit.id; });
  const Signature name = names_.Name(edit.landmark);
  names_ = LandmarkNames(held_);
  if (edit.kind == EditKind::kCalibration) {
    RestoreVehicle(edit, before.content(), &content_);
    return OkStatus();
  }
  if (edit.kind == EditKind::kRetire) {
    const EditedMap carried = before.InFrameOf(*this);
    const LandmarkGroup* const group = carried.GroupOf(edit);
    if (group == nullptr) return NotFound("no landmark '{}'", InertLine(edit.signature.text()));
    return RestoreGroup(*group, names_.Name(edit.landmark), &content_);
  }
  const StatusOr<std::size_t> g = FindGroup(name, content_);
  if (!g.ok()) return OkStatus();  // Retired since.
  if (edit.kind == EditKind::kRename) {
    const Signature& last = names_.Name(edit.landmark);
    return last == name ? OkStatus() : Rename(*g, last, &content_);
  }
  if (edit.kind == EditKind::kMerge) {
    const EditedMap carried = before.InFrameOf(*this);
    SHIFTMAP_ASSIGN_OR_RETURN(const std::size_t was,
                              FindGroup(carried.names().Name(edit.landmark), carried.content()));
    return RestoreMode(edit, carried.content(), was, *g, &content_);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::size_t mode, FindMode(content_.groups[*g], edit.mode));
  RemoveMode(*g, mode, kAbsent, &content_);
  return OkStatus();
}

}  // namespace shiftmap
