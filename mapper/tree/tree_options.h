// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "localizer/models/field_of_view.h"
#include "mapper/frontend/usable_sightings.h"
#include "mapper/tree/anonymous_update.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What becomes of a mode that is found while its group is evaluated, T-IV VI-B and figure 2.
enum class NewModeInsertion {
  /// It holds since the begin of the visit, as all modes of the group: what was seen of the others
  /// meanwhile was clutter to it. Its score starts from the leaf that had taken it for that.
  kBackTrack,
  /// As a child of the leaf that finds it, whatever this leaf took the landmark for before.
  kChild,
};

/// What merging leaves of two filters, T-IV (26).
enum class LeafMerging {
  kHeavier,  ///< The likelier filter.
  kMixture,  ///< Mean and covariance of both, weighted by their probabilities, as T-IV VII-C.
  kNone,     ///< Leaves stay apart until they are too light or too many.
};

struct TreeSlamOptions {
  /// Accepted probability of a wrong decision, in (0, 0.5). T-IV IX-E: 1e-8. [-]
  double alpha = 1e-4;

  int max_leaves = 24;  ///< Kept at most, >= 1.

  /// An observation gates with a landmark inside this share of its distribution, in (0, 1). T-IV
  /// IX-E: 0.99. [-]
  double gate_probability = 0.99;

  /// P_FOV above which a group enters the field of view and below which it leaves, γ1 and γ2 of
  /// T-IV VIII-A. T-IV IX-E: 0.8 and 0.1. [-]
  double fov_enter = 0.8;
  double fov_leave = 0.1;

  /// By the sensor's sector, or by the scans of a lidar if the run has any.
  FieldOfViewOptions field_of_view = {};

  /// A visit ends when its group was out of view and unseen for this long, > 0. [s]
  double visit_gap_s = 5.0;

  /// Rate at which a landmark leaves a mode. [1/s]
  double leave_rate_per_s = 1e-5;

  /// An observation that gates with no mode corrects a leaf that takes it for its mode none the
  /// less, the hypothesis A of T-IV V-B3. Off: it is clutter to that leaf, T-IV VII-B.
  bool update_ungated = false;

  /// `absent` turns into the mode that is found, and is then no longer open, T-IV VII-A. Off: what
  /// was seen may also have been clutter.
  bool transform_alternative = false;

  /// EKF-SLAM as printed is too certain of its heading.
  SlamState::Errors errors = SlamState::Errors::kInvariant;

  NewModeInsertion insertion = NewModeInsertion::kBackTrack;
  LeafMerging merging = LeafMerging::kHeavier;

  /// A mode that is found needs as many sightings in its first visit; else it was clutter.
  int min_sightings = 3;

  /// A mode that is found is another one of its group if the two are not told apart with this added
  /// to their uncertainty. [m]
  double position_floor_m = 0.07;

  bool anonymous = true;  ///< Landmarks without signature are mapped.
  AnonymousOptions anonymous_landmarks = {};

  FrontEndOptions front_end = {};

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

}  // namespace shiftmap
