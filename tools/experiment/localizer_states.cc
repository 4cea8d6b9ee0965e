// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/localizer_states.h"

#include <variant>

#include "localizer/localizer.h"
#include "mapper/parallel.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

enum Column : std::size_t {
  kInitializingColumn,
  kTrackingColumn,
  kModeChangedColumn,
  kUnknownChangeColumn,
  kLostColumn,
  kDuplicateColumn,
};

// Chi-square quantile of 0.999 with 3 degrees of freedom.
constexpr double kOutside = 16.3;

bool PoseIsWrong(const PoseWithCovariance& pose, const Se2& T_map_vehicle) {
  return SquaredMahalanobis(pose.T_map_vehicle, T_map_vehicle, pose.cov_T_map_vehicle) > kOutside;
}

}  // namespace

bool ReportedShift::Confused(ShiftCause cause) const {
  return Said(IsPoseFailure(cause) ? LocalizerState::kUnknownChange : LocalizerState::kLost);
}

const char* ReportColumn(std::size_t column) {
  if (column == kDuplicateColumn) return "DUPLICATE_SIGNATURE";
  return ToString(static_cast<LocalizerState>(column));
}

std::size_t ColumnOf(const ReportedShift& reported, ShiftCause cause) {
  if (reported.Confused(cause)) return IsPoseFailure(cause) ? kUnknownChangeColumn : kLostColumn;
  if (reported.Said(LocalizerState::kLost)) return kLostColumn;
  if (cause == ShiftCause::kDuplicate && reported.duplicate_alarm) return kDuplicateColumn;
  if (reported.Said(LocalizerState::kUnknownChange)) return kUnknownChangeColumn;
  if (reported.Said(LocalizerState::kModeChanged)) return kModeChangedColumn;
  return reported.Said(LocalizerState::kTracking) ? kTrackingColumn : kInitializingColumn;
}

ReportedShift LocalizeShift(const CausedShift& shift, const LocalizerOptions& options) {
  LocalizerOptions started = options;
  started.initial_pose = shift.start;
  Localizer localizer(MapSnapshot("area", VersionNumber(1), "hash", shift.content), started);
  ReportedShift reported;
  reported.first_s.fill(-1.0);
  reported.lost_rightly = true;
  std::size_t scans = 0;
  bool was_lost = false;
  for (const RunEvent& event : shift.events) {
    const Status status = localizer.Process(event);
    SHIFTMAP_CHECK(status.ok(), "{}", Message(status));
    scans += std::holds_alternative<Scan>(event);
    const LocalizerState state = localizer.state();
    const bool lost = state == LocalizerState::kLost;
    if (lost && !was_lost) {
      reported.lost_rightly &=
          PoseIsWrong(localizer.Estimate()->pose, shift.T_map_vehicle[scans - 1]);
    }
    was_lost = lost;
    const Stamp stamp = StampOf(event);
    if (stamp < shift.cause) {
      reported.said_before |=
          state == LocalizerState::kLost || state == LocalizerState::kUnknownChange;
      continue;
    }
    double& first = reported.first_s[static_cast<std::size_t>(state)];
    if (first < 0.0) first = ToSeconds(stamp - shift.cause);
  }
  reported.lost_rightly &= reported.Said(LocalizerState::kLost);
  reported.duplicate_alarm = localizer.Statistics().duplicate_signatures > 0;
  reported.last = localizer.state();
  const auto estimate = localizer.Estimate();
  SHIFTMAP_CHECK(estimate.has_value(), "a shift with a given start has no pose");
  reported.error_m =
      (estimate->pose.T_map_vehicle.translation() - shift.T_map_vehicle.back().translation())
          .norm();
  return reported;
}

CauseTally TallyCause(ShiftCause cause,
                      std::uint64_t first_seed,
                      int shifts,
                      int threads,
                      const LocalizerOptions& options) {
  std::vector<ReportedShift> all(static_cast<std::size_t>(shifts));
  ForEachIndex(all.size(), threads, [&](std::size_t i) {
    all[i] = LocalizeShift(DrawShift(cause, first_seed + i), options);
  });
  CauseTally tally;
  tally.cause = cause;
  tally.shifts = shifts;
  double delays = 0.0;
  int said = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const ReportedShift& reported = all[i];
    ++tally.reported[ColumnOf(reported, cause)];
    tally.said_before += reported.said_before;
    if (reported.Confused(cause)) {
      ++tally.confused;
      tally.pose_wrong += !IsPoseFailure(cause) && reported.lost_rightly;
      tally.confused_seeds.push_back(first_seed + i);
    }
    constexpr double kRight = 0.5;  // [m]
    tally.recovered += reported.last != LocalizerState::kLost && reported.error_m < kRight;
    const auto right = static_cast<std::size_t>(
        IsPoseFailure(cause) ? LocalizerState::kLost : LocalizerState::kUnknownChange);
    if (reported.first_s[right] < 0.0) continue;
    delays += reported.first_s[right];
    ++said;
  }
  if (said > 0) tally.delay_s = delays / said;
  return tally;
}

}  // namespace shiftmap
