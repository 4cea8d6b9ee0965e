// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_utias_data.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "mapper/mapper_options.h"
#include "proto/core/check.h"
#include "tools/convert/utias.h"

namespace shiftmap {
namespace {

// A landmark seen less often than this does not show whether it was displaced.
constexpr int kMinObservations = 10;

// What a survey leaves open: that the landmark stands at none of its places.
constexpr double kAbsentProbability = 0.05;

LandmarkPlaces OftenSeen(const Run& run, const LandmarkPlaces& landmarks) {
  std::map<Signature, int> counts;
  for (const Scan& scan : run.scans) {
    for (const Observation& observation : scan.observations) ++counts[observation.signature];
  }
  LandmarkPlaces seen;
  for (const auto& [signature, place] : landmarks) {
    if (counts[signature] >= kMinObservations) seen.emplace(signature, place);
  }
  return seen;
}

}  // namespace

StatusOr<UtiasCase> LoadUtiasCase(const std::string& data,
                                  int dataset,
                                  int robot,
                                  const UtiasProtocol& protocol) {
  UtiasOptions options;
  options.dataset_dir = fmt::format("{}/MRCLAM_Dataset{}", data, dataset);
  options.robot = robot;
  UtiasCase result;
  result.dataset = dataset;
  result.robot = robot;
  result.start_s = protocol.start_s;
  SHIFTMAP_ASSIGN_OR_RETURN(result.truth, ReadUtiasGroundtruth(options.dataset_dir, robot));
  SHIFTMAP_ASSIGN_OR_RETURN(result.landmarks, ReadUtiasLandmarks(options.dataset_dir));
  if (result.truth.empty()) {
    return InvalidArgument("utias data set {} robot {}: no motion capture", dataset, robot);
  }
  options.duration_s = protocol.duration_s;
  SHIFTMAP_ASSIGN_OR_RETURN(UtiasRun recorded, ReadUtias(options));
  const Duration late = result.truth.front().stamp - recorded.run.odometry.front().stamp;
  options.start_s = protocol.start_s + std::max(0.0, ToSeconds(late));
  if (options.start_s > 0.0) {
    SHIFTMAP_ASSIGN_OR_RETURN(recorded, ReadUtias(options));
  }
  result.run =
      WithinFieldOfView(std::move(recorded.run), protocol.max_range_m, protocol.max_bearing_rad);
  const LandmarkPlaces seen = OftenSeen(result.run, result.landmarks);
  if (std::ssize(seen) < protocol.moved_landmarks || seen.empty()) {
    return InvalidArgument("utias data set {} robot {}: {} landmarks seen, expected {} or more",
                           dataset,
                           robot,
                           seen.size(),
                           std::max(1, protocol.moved_landmarks));
  }
  result.moved = ClosestTogether(seen, protocol.moved_landmarks);
  for (const auto& [signature, place] : result.landmarks) result.signatures.push_back(signature);
  result.frames = MakeMappingRun(result.run, result.signatures, {});
  return result;
}

Run WithinFieldOfView(Run run, double max_range_m, double max_bearing_rad) {
  for (Scan& scan : run.scans) {
    std::erase_if(scan.observations, [&](const Observation& observation) {
      const Eigen::Vector2d q = observation.PositionInVehicle();
      return q.norm() >= max_range_m || std::abs(std::atan2(q.y(), q.x())) >= max_bearing_rad;
    });
  }
  return run;
}

std::vector<Signature> ClosestTogether(const LandmarkPlaces& places, int count) {
  SHIFTMAP_CHECK(count >= 1 && count <= std::ssize(places) && places.size() <= 20,
                 "{} of {} places",
                 count,
                 places.size());
  const std::vector<std::pair<Signature, Eigen::Vector2d>> all(places.begin(), places.end());
  double least = std::numeric_limits<double>::infinity();
  std::uint32_t best = 0;
  for (std::uint32_t subset = 0; subset < (1u << all.size()); ++subset) {
    if (std::popcount(subset) != count) continue;
    double sum = 0.0;
    for (std::size_t a = 0; a < all.size(); ++a) {
      for (std::size_t b = a + 1; b < all.size(); ++b) {
        const bool both = (subset >> a & 1u) != 0 && (subset >> b & 1u) != 0;
        if (both) sum += (all[a].second - all[b].second).squaredNorm();
      }
    }
    if (sum < least) {
      least = sum;
      best = subset;
    }
  }
  std::vector<Signature> chosen;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if ((best >> i & 1u) != 0) chosen.push_back(all[i].first);
  }
  return chosen;
}

LandmarkPlaces Displaced(LandmarkPlaces places,
                         const std::vector<Signature>& moved,
                         double delta_m) {
  for (const Signature& signature : moved) places.at(signature).x() += delta_m;
  return places;
}

MapContent SurveyMap(const LandmarkPlaces& places, double sd_m, Stamp stamp) {
  MapContent content;
  content.stamp = stamp;
  const Eigen::Matrix2d cov = Eigen::Matrix2d::Identity() * (sd_m * sd_m);
  for (const auto& [signature, place] : places) {
    LandmarkGroup group;
    group.signature = signature;
    group.modes.push_back({ModeNumber(1), place, cov, {}});
    group.probabilities = Eigen::Vector2d(kAbsentProbability, 1.0 - kAbsentProbability);
    group.chain = ModeChain::Uniform(1, ModeOptions().leave_rate_per_s);
    content.groups.push_back(std::move(group));
  }
  content.covariance = JointCovariance(std::vector<Eigen::Matrix2d>(places.size(), cov), {});
  return content;
}

}  // namespace shiftmap
