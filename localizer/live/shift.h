// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "localizer/live/drop_counts.h"
#include "localizer/live/messages.h"
#include "localizer/live/pose_predictor.h"
#include "localizer/localizer.h"

namespace shiftmap::live {

/// One shift of a live vehicle: the localizer, the pose between scans, and what there is to tell.
///
/// Determinism: the header and the same calls give the same bits; that is how a shift is resumed.
/// No I/O.
class Shift {
 public:
  /// @param map  The vehicle's own calibration is used if it has one.
  /// Precondition: the header's options are valid (LocalizerOptions::Validate).
  Shift(const MapSnapshot& map, const ShiftHeader& header);

  /// The localizer's options that a header states; the others have their defaults.
  static LocalizerOptions OptionsOf(const ShiftHeader& header);

  /// Takes in an item and appends what subscribers may want to know to `events`.
  /// Errors: as Localizer::Process; the shift is then as before.
  Status Process(const RunEvent& item, std::vector<Event>* events);

  /// Localizes what waits for late items, since the stream pauses; appends to `events`.
  void LocalizeHeld(std::vector<Event>* events);

  /// As Localizer::Initialize.
  void Initialize(const PoseWithCovariance& pose) { localizer_.Initialize(pose); }

  /// The report of the shift if it ended now, without items that a report cannot hold; the shift
  /// itself can go on.
  /// @param dropped  What did not reach the localizer.
  ShiftReport Report(DropCounts dropped) const;

  /// Where the vehicle is, for the next start; nothing if the localizer does not trust its pose,
  /// or ValidateStart() does not.
  std::optional<SavedPose> PoseToSave() const;

  /// The pose after a time in which the vehicle went on unseen, with its last velocity at most;
  /// nothing if the localizer does not trust its pose or that way is too long.
  /// @param unseen_s  >= 0. [s]
  std::optional<PoseWithCovariance> PoseAfter(double unseen_s) const;

  /// The pose after the last item, of finite numbers.
  const std::optional<PoseEstimate>& Pose() const { return pose_; }

  /// The probability with which the model itself would fit the last observations as badly, uniform
  /// in [0, 1] if it holds; less where most landmarks of the last second fail, 0 before the first
  /// is seen. Precondition: there is a pose.
  double Score() const;

  /// The radius about Pose() that holds the position with a probability, over all hypotheses; they
  /// moved as Pose() did since the last scan. Precondition: there is a pose. [m]
  double RadiusHolding(double probability) const;

  /// Odometry has said for half a second that the vehicle stands.
  bool Stands() const;

  const ShiftHeader& header() const { return header_; }
  const Localizer& localizer() const { return localizer_; }
  Stamp now() const { return now_; }

 private:
  void TellOdometer(const OdometrySample& sample);
  void UpdatePose();
  void ReportEvents(std::vector<Event>* events);

  ShiftHeader header_;
  Localizer localizer_;
  PosePredictor predictor_;
  std::optional<PoseEstimate> pose_;
  Stamp now_;  // Of the last item.
  std::optional<OdometrySample> last_sample_;
  double driven_m_ = 0.0;
  std::optional<Stamp> standing_since_;
  std::int64_t corrected_scans_ = 0;  // Localized, as of the last item.
  LocalizerState told_state_ = LocalizerState::kInitializing;
};

}  // namespace shiftmap::live
