// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "mapper/build_progress.h"
#include "mapper/calibration/vehicle_calibration.h"
#include "mapper/chain/group_chains.h"
#include "mapper/mapped_run.h"
#include "mapper/mapper_input.h"
#include "mapper/mapper_options.h"
#include "mapper/modes/selection_summary.h"
#include "mapper/state/undecided_runs.h"
#include "mapstore/map/map_snapshot.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Changes between a run and the map that have several explanations, or none that fits.
struct AmbiguousChange {
  struct Alternative {
    std::vector<Signature> stayed;  ///< None: fewer than two landmarks did.
    std::vector<Signature> moved;   ///< Of those in common.
    double probability = 0.0;
  };

  /// The run does not fit as well as by itself with landmarks where the map has them (JoinedFit).
  struct Misfit {
    std::vector<Signature> stayed;  ///< These.
    double chi2 = 0.0;
    double limit = 0.0;  ///< Of chi2.
    int degrees_of_freedom = 0;
  };

  /// The runs wait. Else they are in the map, in a frame that all explanations have, and landmarks
  /// have the modes of all.
  bool waits = true;

  std::vector<RunName> runs;
  std::vector<Alternative> explanations;  ///< By falling probability, the unlikely ones left out.

  /// Stayed in one of the first two explanations only: another run past them decides.
  std::vector<Signature> deciding;

  std::optional<Misfit> misfit;  ///< There are no explanations then.
};

/// Without a run if all that there are wait; the content is then that of the prior map.
struct MapperResult {
  MapContent content;
  std::vector<MappedRun> runs;  ///< By begin, then hash.
  std::vector<RejectedRun> rejected;
  std::vector<AmbiguousChange> ambiguous_changes;
  int modes_created = 0;  ///< Modes that the prior map does not have.
  int modes_merged = 0;
  double disagreement = 1.0;  ///< Of the runs and the prior map (MapDisagreement::factor).
  int outer_iterations = 0;
  SelectionSummary selection;
  std::int64_t estimated_memory_bytes = 0;  ///< What the build was expected to take at its peak.
  std::vector<VehicleEstimate> vehicles;    ///< By name; none if the options do not calibrate.
  std::vector<RunRecord> older;             ///< What older runs say of new modes.
  std::vector<GroupChain> chains;           ///< As learned, one per group of the content; or none.
};

/// Builds a map of one area from runs of any vehicles and days, IJRR 3-7 as a graph:
///
/// - Landmarks without signature get the names of tracks, if the options say so.
/// - Each run by itself: odometry calibration from pairs of sightings, a trajectory by EKF-SLAM,
///   one robust position per landmark, then selection and graph in turn.
/// - Runs are placed in one frame by the largest set of signatures that agree, which works when
///   most landmarks have moved in between. If the options confirm it, a run that few agree with
///   waits, unless nothing else explains it.
/// - All runs in one graph, where positions of one landmark that differ are its modes: selection by
///   Viterbi over visits, mode creation and merging, continuous solve, until nothing changes.
/// - Noise, field of view and detection rate are estimated; joint covariance, mode probabilities.
///
/// Without a prior the map frame is the start pose of the earliest run, and covariances are
/// relative to the landmarks as a whole (inner constraints), not to that pose. With a prior the map
/// frame is its frame, and its modes enter as a joint Gaussian; their numbers stay.
///
/// The result does not depend on the order of `inputs`. Same input and options, same bits, on any
/// number of threads. Errors: kInvalidArgument if no run can be used, options are out of range, or
/// the build needs more memory than they allow; kCancelled if the monitor asked for it.
StatusOr<MapperResult> BuildMap(std::vector<MapperInput> inputs,
                                const std::optional<MapContent>& prior,
                                const MapperOptions& options,
                                const MapperMonitor& monitor = {});

}  // namespace shiftmap
