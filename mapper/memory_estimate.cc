// SPDX-License-Identifier: Apache-2.0
#include "mapper/memory_estimate.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <set>
#include <vector>

#include "mapper/alignment/consensus.h"
#include "mapper/calibration/distortion_calibration.h"
#include "mapper/covariance/mode_covariance.h"
#include "mapper/graph/graph.h"
#include "mapper/graph/graph_segments.h"
#include "mapper/graph/residuals.h"
#include "mapper/state/build_state.h"

namespace shiftmap {
namespace {

constexpr std::int64_t kMib = std::int64_t{1024} * 1024;

// The program, its libraries, and what the store's library caches.
constexpr std::int64_t kProgram = 22 * kMib;

// A log is there as it was read and as it is arranged.
constexpr std::int64_t kLogCopies = 2;

// Graphs alive at a time: a run's own, the common one, and the one that it is copied from.
constexpr std::int64_t kGraphCopies = 3;

// What a segment couples with in addition to modes: its two separators and its run's calibration.
constexpr std::int64_t kSegmentEnds = 2 * 3 + kRunCalibration;

// Per key frame of a segment and column of its boundary, rows of Y; per key frame its factor.
// [bytes]
constexpr std::int64_t kSegmentRow = std::int64_t{3} * 8;
constexpr std::int64_t kSegmentFactor = std::int64_t{2} * 72;

// Per pair of columns of a segment's boundary: its term in the reduced system, and two entries of
// fronts, since calibrations widen those that take it up. [bytes]
constexpr std::int64_t kSegmentPair = 8 + 2 * 8;

// Dense matrices over the positions of all modes alive at a time while the joint covariance is
// referred to the gauge, and the blocks of it that the map keeps; of a large map over those of
// kMaxJointModes, and copies of the blocks of its tiles.
constexpr std::int64_t kDenseMatrices = 7;
constexpr std::int64_t kTileCopies = 4;

// Dense matrices over the landmarks of a run alive at a time while EKF-SLAM maps it.
constexpr std::int64_t kRunMatrices = 5;

// A run beside others brings a mode for every so many landmarks that it sees.
constexpr std::int64_t kLandmarksPerNewMode = 4;

}  // namespace

void AddRun(const Run& run, BuildSize* size) {
  std::set<Signature> seen;
  std::set<Signature> from_segment;
  std::int64_t key_frames = 0;
  const auto end_segment = [&] {
    const std::int64_t boundary = kSegmentEnds + 2 * std::ssize(from_segment);
    size->segment_boundary += boundary;
    size->segment_pairs += boundary * boundary;
    seen.merge(from_segment);
    from_segment.clear();
  };
  for (const Scan& scan : run.scans) {
    bool identified = false;
    for (const Observation& observation : scan.observations) {
      if (observation.signature.anonymous()) continue;
      identified = true;
      from_segment.insert(observation.signature);
    }
    if (identified && ++key_frames % (kSegmentPoses + 1) == 0) end_segment();
    size->observations += static_cast<std::int64_t>(scan.observations.size());
  }
  end_segment();
  size->key_frames += key_frames;
  const auto landmarks = static_cast<std::int64_t>(seen.size());
  size->odometry_samples += static_cast<std::int64_t>(run.odometry.size());
  for (const LidarScan& scan : run.lidar_scans) size->lidar_beams += std::ssize(scan.ranges_m);
  size->landmarks = std::max(size->landmarks, landmarks);
  size->scans += static_cast<std::int64_t>(run.scans.size());
  size->runs += 1;
  size->vehicles.insert(run.info.vehicle);
  size->all_landmarks += landmarks;
  size->landmark_pairs += landmarks * landmarks;
}

void AddSize(const BuildSize& runs, BuildSize* size) {
  size->odometry_samples += runs.odometry_samples;
  size->lidar_beams += runs.lidar_beams;
  size->scans += runs.scans;
  size->observations += runs.observations;
  size->key_frames += runs.key_frames;
  size->segment_boundary += runs.segment_boundary;
  size->segment_pairs += runs.segment_pairs;
  size->runs += runs.runs;
  size->vehicles.insert(runs.vehicles.begin(), runs.vehicles.end());
  size->landmarks = std::max(size->landmarks, runs.landmarks);
  size->all_landmarks += runs.all_landmarks;
  size->landmark_pairs += runs.landmark_pairs;
}

std::int64_t ExpectedModes(const BuildSize& size) {
  const std::int64_t first = size.prior_modes > 0 ? 0 : size.landmarks;
  return size.prior_modes + first + (size.all_landmarks - first) / kLandmarksPerNewMode + size.runs;
}

std::int64_t EstimateBuildMemory(const BuildSize& size) {
  const auto bytes = [](std::size_t value) { return static_cast<std::int64_t>(value); };
  const std::int64_t logs = size.odometry_samples * bytes(sizeof(OdometrySample)) +
                            size.lidar_beams * bytes(sizeof(float)) +
                            size.scans * bytes(sizeof(Scan)) +
                            size.observations * bytes(sizeof(Observation));
  const std::int64_t graph =
      size.key_frames * bytes(sizeof(Se2) + sizeof(MotionIncrement) + sizeof(MotionResidual)) +
      size.observations * bytes(sizeof(GraphObservation) + sizeof(ObservationResidual));
  const std::int64_t block = 4 * bytes(sizeof(double));
  const std::int64_t modes = size.modes.value_or(ExpectedModes(size));
  const std::int64_t dense = std::min<std::int64_t>(modes, kMaxJointModes);
  const std::int64_t joint = kDenseMatrices * dense * dense * block;
  const std::int64_t tiles = modes > dense ? kTileCopies * modes * kTileModes * block : 0;
  const std::int64_t runs =
      kRunMatrices * size.runs_at_once * size.landmarks * size.landmarks * block;
  // Runs wait for their place with their joint covariances, and each with a list for every group.
  const std::int64_t waiting =
      size.landmark_pairs * block +
      size.all_landmarks * bytes(sizeof(BuildMode) + sizeof(AlignmentPoint)) +
      size.runs * modes * bytes(sizeof(std::vector<BuildMode>));
  const std::int64_t segments = size.segment_boundary * kSegmentPoses * kSegmentRow +
                                size.key_frames * kSegmentFactor +
                                size.segment_pairs * kSegmentPair;
  // The error functions of sensors in the boundaries of their segments, and in what remains.
  const std::int64_t functions =
      kErrorFunctions * std::ssize(size.vehicles) + kCommonErrorFunctions;
  const std::int64_t remaining =
      3 * size.key_frames / kSegmentPoses + kRunCalibration * size.runs + 2 * modes;
  const std::int64_t distortions =
      bytes(sizeof(double)) *
      ((kErrorFunctions + kCommonErrorFunctions) * size.segment_boundary + functions * remaining);
  const std::int64_t smooth = size.odometry_samples * bytes(sizeof(OdometrySample));
  return kProgram + kLogCopies * logs + smooth + kGraphCopies * graph + segments + joint + tiles +
         runs + waiting + distortions;
}

Status CheckBuildMemory(const BuildSize& size, std::int64_t max_memory_bytes) {
  const std::int64_t needed = EstimateBuildMemory(size);
  if (max_memory_bytes == 0 || needed <= max_memory_bytes) return OkStatus();
  return InvalidArgument(
      "build: {} key frames and {} modes take about {} MiB, allowed are {}; build fewer runs at a "
      "time",
      size.key_frames,
      size.modes.value_or(ExpectedModes(size)),
      needed / kMib + 1,
      max_memory_bytes / kMib);
}

BuildSize RunChoice::Total() const {
  BuildSize total;
  total.prior_modes = prior_modes_;
  for (const auto& [key, size] : kept_) AddSize(size, &total);
  total.runs_at_once = std::min<std::int64_t>(threads_, std::ssize(kept_));
  return total;
}

// Of the runs in the order of their size, those up to the first that does not fit are never left
// out: a set in which such a run is the largest fits. What is left are no others, since all from
// the smallest one that was left out on are.
std::vector<RunChoice::LeftOut> RunChoice::Add(const std::string& id, const BuildSize& size) {
  BuildSize alone = size;
  alone.prior_modes = prior_modes_;
  kept_.emplace(Key(EstimateBuildMemory(alone), id), size);
  std::vector<LeftOut> left_out;
  while (!kept_.empty()) {
    const auto largest = std::prev(kept_.end());
    const bool beyond = first_left_out_ && largest->first > *first_left_out_;
    if (!beyond && CheckBuildMemory(Total(), max_memory_bytes_).ok()) break;
    left_out.push_back(
        {largest->first.second,
         fmt::format("a build takes about {} MiB with it alone, allowed are {} with all runs",
                     largest->first.first / kMib + 1,
                     max_memory_bytes_ / kMib)});
    if (!beyond) first_left_out_ = largest->first;
    kept_.erase(largest);
  }
  return left_out;
}

void RunChoice::Remove(const std::string& id) {
  std::erase_if(kept_, [&](const auto& kept) { return kept.first.second == id; });
}

}  // namespace shiftmap
