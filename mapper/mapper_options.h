// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <vector>

#include "mapper/alignment/consensus.h"
#include "mapper/alignment/displaced_landmarks.h"
#include "mapper/alignment/explanation_search.h"
#include "mapper/alignment/move_prior.h"
#include "mapper/association/anonymous_tracks.h"
#include "mapper/chain/group_chains.h"
#include "mapper/frontend/mapping_run.h"
#include "mapper/graph/solver_limits.h"
#include "mapper/modes/missed_detection_model.h"
#include "mapper/selection/selector.h"
#include "mapstore/core/clock.h"
#include "mapstore/map/calibration.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/map/run_record.h"
#include "mapstore/map/visibility.h"
#include "proto/core/status.h"

namespace shiftmap {

struct ModeOptions {
  /// A new mode needs as many sightings in one visit: one misread signature makes none.
  int min_sightings = 3;

  /// Sightings of a visit within this distance of its centre belong together. [m]
  double cluster_radius_m = 0.5;

  /// Positions of one landmark are one mode unless they are told apart: by their joint uncertainty
  /// with this added to either position for what the models leave out. [m]
  double position_floor_m = 0.07;

  /// Probability at which two positions are told apart.
  double merge_probability = 0.99;

  /// A position that is known no better than this may be anywhere: that it is near another is then
  /// no sign that they are one. [m]
  double max_merge_sd_m = 4.0;

  /// Rate at which a landmark is taken to leave a mode before there is evidence to learn it from.
  /// [1/s]
  double leave_rate_per_s = 1e-5;

  /// Error of pose and map that the sightings of a visit share where it is scored against a mode.
  /// Until runs are placed in the map it is one of each sighting. [m]
  double score_position_sd_m = 0.10;

  /// Density of the places where an object is misread as a landmark for a burst of scans. Its ratio
  /// to the density of new landmarks bounds the evidence of one visit for a new place. [1/m²]
  double misread_density_per_m2 = 1e-6;

  /// How the mode of a visit is chosen from the chain over its group's visits.
  SelectorOptions selector;
};

/// The rates of the map's mode chains.
struct ChainOptions {
  /// Learn them from `ledger` and the visits of the build, with ModeOptions::leave_rate_per_s as
  /// the prior's mean. Else known groups keep theirs and others get that rate.
  bool learn = true;

  GroupChainOptions learning;  ///< Its leave_rate_per_s is that of ModeOptions.

  /// What shifts reported along the line of the prior map, but nothing about a run that the build
  /// takes: its visits are evidence already.
  std::vector<EvidenceRow> ledger;

  /// Landmarks that get the chain that is learned whatever the prior map has.
  std::set<Signature> relearned;
};

/// When few landmarks agree, or others agree at another place, the place of a run in the map must
/// be confirmed against other explanations of the same modes (Explain).
struct ConfirmationOptions {
  bool enabled = true;  ///< If not, every run is placed where most landmarks agree.

  /// Few agree in a consensus of fewer signatures, or of this share of those in common or less, the
  /// landmarks of one body counted as one: the explanation then says which landmarks stayed, else
  /// FindDisplaced().
  int min_signatures = 5;
  double min_share = 0.5;

  /// A frame that is less likely than this is not decided for, and the run waits.
  double min_probability = 0.99;

  /// The same for the frame of a consensus in which more than few agree, and for the result of
  /// FindDisplaced() in it. MovePrior gives every number of landmarks that stayed the same
  /// probability; that most of them stayed is more probable than that.
  double min_probability_of_most = 0.9;

  /// A run whose fit with the others is this improbable beside its fit by itself (FitJoined) is
  /// taken out again, and waits.
  double false_misfit = 1e-6;

  /// A mode of which the run by itself is nearer to another one of its landmark by this factor was
  /// taken for that one, and says nothing of the fit.
  double mistaken_distance_ratio = 3.0;

  /// Modes that the map has of a run's landmarks up to which its place is confirmed, and modes of a
  /// run up to which its fit is: their covariance is dense.
  int max_modes = 300;

  MovePrior prior;
  ExplanationLimits limits;
};

/// What no working vehicle exceeds: a run that does fits itself, and deforms the map. It is left
/// out with the reason.
struct PlausibilityOptions {
  /// Ten times the prior standard deviation and more; a person who mounts a sensor gets nearer.
  double max_bearing_offset_rad = 0.6;

  /// Of speeds and yaw rates, either way: odometry in other units, or of another wheel. [-]
  double max_scale = 2.0;

  /// Recorded robots lose 0.02 to 0.04. [rad/√s]
  double max_noise_omega = 0.12;

  /// Of a vehicle whose wheels slip on half of its way at a walk. [m/√s]
  double max_noise_v = 0.5;

  /// What detects landmarks tells their direction at least this well.
  double max_sd_bearing_rad = 0.5;

  /// Log odds from which on odometry counts turns, or ways, the other way.
  double reversed_log_odds = 10.0;

  /// Share of a run's observations that its own map leaves unexplained, in visits that are long
  /// enough for a mode: of so many misread ones some agree by chance, and the map may rest on them.
  double max_outliers = 0.4;
};

/// When a run lays a second map beside that of the others, and how it is put back
/// (RelocateMisregisteredRuns).
struct RelocationOptions {
  /// A run is tried elsewhere if other runs know this number of its landmarks elsewhere, or those
  /// of this number of its visits in a row.
  int min_visits = 6;

  /// Visits of a part: enough of them to be aligned, and no loop to close.
  double part_visits = 24.0;

  /// A visit this near to a mode of the others is of that. [m]
  double same_place_m = 1.0;

  /// Two landmarks in a row may be displaced because the run is deformed if displacements differ
  /// by `same_place_m` and a turn by this, and have moved if by more. [rad]
  double max_turn_rad = 0.2;
};

/// How a run that is known badly at its far end is deformed onto the map.
struct DeformationOptions {
  /// A run map whose worst mode is known this well against the others is stiff: its covariance,
  /// which is linear, says how it may differ from the map. Standard deviation. [m]
  double stiff_sd_m = 0.15;

  /// What is deformed by less is solved no further: a run that is deformed by 0.25 m a metre from
  /// where it turns is off the tangent by half its square. [m]
  double max_linear_m = 0.25;

  /// How well a mode is to be known to be matched, at first and at last. A vehicle that comes back
  /// to mapped ground after a while is less sure where it is: only when nothing else is left is the
  /// limit raised. Standard deviations. [m]
  double first_max_sd_m = 0.5;
  double last_max_sd_m = 4.0;

  /// Matches that the others contradict at this probability are none.
  double contradiction = 0.999;

  /// The map is deformed as well: variance of the difference over that of the run map.
  double variance_factor = 2.0;
};

/// What is known of how much maps disagree before they are compared (EstimateRunVariances).
struct DisagreementOptions {
  /// The covariances are right, as so many degrees of freedom would tell.
  double prior_dof = 10.0;

  /// A mode whose difference is less probable, beside those of the others, is an outlier: it was
  /// moved a little, and is known that badly.
  double outlier_probability = 1e-4;

  /// None is where the mean square of all is not larger, nor among fewer modes.
  double expected_mean_square = 1.5;
  int min_modes = 6;
};

struct MapperOptions {
  FrontEndOptions front_end;
  AssociationOptions association;  ///< Of observations without a signature.
  AlignmentOptions alignment;
  ConfirmationOptions confirmation;
  DisplacementOptions displacement;
  DeformationOptions deformation;
  PlausibilityOptions plausibility;
  RelocationOptions relocation;
  DisagreementOptions disagreement;
  ModeOptions modes;
  MissedDetectionOptions missed;

  /// From where runs along the line of the prior map saw its modes, by signature; no run of the
  /// build among them.
  std::vector<ModeVisibility> visibility;

  /// Runs along the line of the prior map that modes of the build are new to; none of the build.
  std::vector<RunRecord> older_runs;

  ChainOptions chains;

  /// Where calibration starts, and what is used as it is when `calibrate` is off.
  Calibration calibration;
  bool calibrate = true;

  /// How well the fleet's sensors know lengths: what they get wrong together goes into the map's
  /// covariance, what each run's gets wrong beside it is estimated (TellsScales).
  /// Standard deviations; 0: exactly. [-]
  double sd_range_scale = 0.02;
  double sd_run_range_scale = 0.01;

  /// What a run's sensor reads too much, before the run tells: standard deviations of the bearing
  /// [rad] and of the range over the square of the bearing [1/rad²].
  double sd_bearing_offset_rad = 0.05;
  double sd_range_curvature_per_rad2 = 0.5;

  /// What a vehicle's sensor gets wrong over its field of view beyond that: standard deviation of
  /// these errors over that of its noise (SensorDistortion); 0: none. [-]
  double distortion_share = 0.5;

  /// Once runs are placed, what is so many standard deviations from its mode is an outlier.
  double loss_reach_sds = 50.0;

  /// Alternations of mode selection and solving at most.
  int max_outer_iterations = 20;

  /// What minimizes and tells covariances.
  SolverKind solver_kind = SolverKind::kSchur;

  /// Of each minimization. Odometry is then integrated anew at the calibration found, at most so
  /// often, if that does not stay earlier.
  SolverLimits solver;
  int max_integrations = 4;

  std::uint64_t seed = 1;

  /// On which runs are mapped singly, visits scored and segments eliminated; >= 1. The result does
  /// not depend on it, not in a bit.
  int threads = 1;

  /// A build that would take more than this is refused before it does. 0: no bound. [bytes]
  std::int64_t max_memory_bytes = 0;

  /// This host's clock, if the map's stamp may not be ahead of it. A prior map that is ahead by
  /// more than the tolerance counts as of the begin of the earliest run: its stamp says nothing.
  std::optional<Stamp> now;
  double clock_tolerance_s = kDefaultClockToleranceS;

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

}  // namespace shiftmap
