// SPDX-License-Identifier: Apache-2.0
//
// The recording of a shift: an MCAP file that Foxglove opens, with these messages.
//
//   topic              schema                           when
//   /shift             shiftmap.proto.RecordedShift     once, first
//   /map               shiftmap.proto.Map               once: the map with its probabilities, but
//                                                       without correlations between modes
//   /map/scene         foxglove.SceneUpdate             landmarks whose probabilities changed, 1 Hz
//   /pose              foxglove.PoseInFrame             after a scan, at most 10 Hz
//   /tf                foxglove.FrameTransform          with it: `vehicle` in `map`
//   /pose_estimate     shiftmap.proto.PoseEvent         with it: covariance and state
//   /state             shiftmap.proto.StateChanged      every change
//   /decisions         shiftmap.proto.DecisionChanged   every decision, and one taken back
//   /log               foxglove.Log                     both, in words
//   /innovations       shiftmap.proto.ScanInnovations   every scan with a known signature
//   /hypotheses        shiftmap.proto.HypothesesSample  tree, leaf weights, visits; at most 2 Hz
//   /hypotheses/poses  foxglove.PosesInFrame            with it: the poses of the leaves
//   /hypotheses/scene  foxglove.SceneUpdate             with it: the same, opacity = weight
//
// The structs below are the messages of shiftmap.proto as values (proto/recording.proto says what
// each field means).
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "localizer/hypothesis/hypothesis_view.h"
#include "localizer/live/messages.h"
#include "localizer/monitor/state_change.h"
#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/map_snapshot.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Which shift, and on which map.
struct RecordedShift {
  std::string vehicle;
  std::string area;
  VersionNumber version;
  std::string content_hash;
  std::string run_uuid;            ///< Empty if the log has none.
  std::string software;            ///< Name and version of what recorded it.
  std::string calibrated_vehicle;  ///< Whose calibration the shift uses; empty: the fleet's.
};

/// A decision was made, or taken back because the pose that it rests on was wrong.
struct DecisionChange {
  Stamp stamp;  ///< When that became known.
  Decision decision;
  bool withdrawn = false;
};

/// One observation of a known signature against the heaviest leaf.
struct RecordedInnovation {
  Signature signature;
  ModeNumber mode = kAbsent;  ///< That it gated with; kAbsent: none, and the rest is 0.
  Eigen::Vector2d nu = Eigen::Vector2d::Zero();  ///< Observed - expected, vehicle frame. [m]
  Eigen::Matrix2d S = Eigen::Matrix2d::Zero();   ///< Covariance of nu, order (x, y). [m²]
  double nis = 0.0;                              ///< νᵀ S⁻¹ ν, 2 dof.
};

struct ScanInnovations {
  Stamp stamp;
  double quality = 1.0;  ///< InnovationQuality::p_value() after the scan.
  std::vector<RecordedInnovation> innovations;
};

/// Of the innovations of a scan that gated with a mode.
struct NisSum {
  double sum = 0.0;
  std::int64_t updates = 0;  ///< 2 dof each.
};
NisSum GatedNis(const ScanInnovations& scan);

struct HypothesesSample {
  Stamp stamp;
  HypothesisView view;
  std::vector<double> leaf_weights;  ///< Of the heaviest leaves, descending.
};

/// A whole recording in memory, each list in the order of time.
struct ShiftRecording {
  RecordedShift shift;
  std::optional<MapSnapshot> map;  ///< Nothing only if the file ends before it.
  std::vector<live::PoseEvent> poses;
  std::vector<StateChange> states;
  std::vector<DecisionChange> decisions;
  std::vector<ScanInnovations> innovations;
  std::vector<HypothesesSample> hypotheses;
  std::string truncation;  ///< Non-empty if the file ends early: says where.
};

/// Whether a file begins as a recording does.
bool BeginsAsRecording(const std::string& path);

/// Reads a recording whole. Topics that are not of the table are skipped.
/// Errors: kNotFound; kInvalidArgument if it is no recording, a message does not hold what its
/// schema says, or it takes more than a quarter of MemoryBound(); kDataLoss if a checksum is wrong.
/// Messages start with `recording 'PATH': `.
StatusOr<ShiftRecording> ReadShiftRecording(const std::string& path);

}  // namespace shiftmap
