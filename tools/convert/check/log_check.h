// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

#include "mapstore/core/clock.h"
#include "mapstore/run/item_limits.h"
#include "mapstore/run/run.h"
#include "tools/convert/check/finding.h"
#include "tools/convert/check/lag_check.h"
#include "tools/convert/check/motion_check.h"
#include "tools/convert/check/odometry_check.h"
#include "tools/convert/check/scan_check.h"
#include "tools/convert/check/time_check.h"

namespace shiftmap {

struct LogCheckOptions {
  ItemLimits limits;
  Stamp now;                                           ///< This host's clock.
  double clock_tolerance_s = kDefaultClockToleranceS;  ///< >= 0. [s]
};

/// Looks for mistakes of recorders and drivers in a run log, item by item, in memory that does not
/// grow with the log beyond what its signatures and pairs take (some 20 MiB).
class LogCheck {
 public:
  explicit LogCheck(const LogCheckOptions& options);

  /// Takes an item, in the order of the log.
  void Add(const RunEvent& event);

  /// All findings, errors first, then by what they are about. Call once, last.
  /// @param info  Of the log.
  Findings Finish(const RunInfo& info) const;

  const TimeCheck& odometry_times() const { return odometry_times_; }
  const TimeCheck& scan_times() const { return scan_times_; }
  const OdometryCheck& odometry() const { return odometry_; }
  const ScanCheck& scans() const { return scans_; }
  const MotionCheck& motion() const { return motion_; }
  const LagCheck& lag() const { return lag_; }
  std::int64_t lidar_scans() const { return lidar_scans_; }

 private:
  void CheckInfo(const RunInfo& info, Findings* findings) const;
  void CheckClock(Findings* findings) const;
  void CheckOverlap(Findings* findings) const;
  void CheckMotion(Findings* findings) const;

  LogCheckOptions options_;
  TimeCheck odometry_times_;
  TimeCheck scan_times_;
  OdometryCheck odometry_;
  ScanCheck scans_;
  MotionCheck motion_;
  LagCheck lag_;
  std::int64_t lidar_scans_ = 0;
  std::optional<Stamp> newest_;
  Duration worst_lateness_{0};
  Stamp latest_at_;
  std::int64_t late_ = 0;
};

}  // namespace shiftmap
