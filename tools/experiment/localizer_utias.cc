// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/localizer_utias.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <random>
#include <utility>

#include "localizer/filter/odometry_buffer.h"
#include "localizer/hypothesis/hypothesis_bank.h"
#include "localizer/models/observation_model.h"
#include "mapper/mapper.h"
#include "mapstore/core/median.h"
#include "tools/convert/utias.h"

namespace shiftmap {
namespace {

const Duration kMaxTruthGap = FromSeconds(1.0);

// State per layout of one landmark: layouts closer than `same_place_m` share one.
std::vector<int> StatesOf(const std::vector<Layout>& layouts,
                          const Signature& signature,
                          double same_place_m,
                          std::vector<Eigen::Vector2d>* places) {
  std::vector<int> states;
  for (const Layout& layout : layouts) {
    const Eigen::Vector2d& p = layout.at(signature);
    const auto same =
        std::find_if(places->begin(), places->end(), [&](const Eigen::Vector2d& other) {
          return (other - p).norm() < same_place_m;
        });
    states.push_back(static_cast<int>(same - places->begin()) + 1);
    if (same == places->end()) places->push_back(p);
  }
  return states;
}

struct Drive {
  double rmse_m = 0.0;
  std::vector<Decision> decisions;
  std::vector<int> observations;  // Of its group up to each decision.
};

PoseWithCovariance DrawStart(const Se2& T_map_vehicle,
                             const LayoutOptions& options,
                             std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const Eigen::Vector3d sd(options.sd_start_m, options.sd_start_m, options.sd_start_rad);
  const double x = normal(random);
  const double y = normal(random);
  const Eigen::Vector3d xi = sd.cwiseProduct(Eigen::Vector3d(x, y, normal(random)));
  return {T_map_vehicle * Se2::Exp(xi), sd.cwiseAbs2().asDiagonal()};
}

Drive Localize(const TrueShift& shift,
               const MapContent& content,
               const LayoutOptions& options,
               std::uint64_t seed) {
  const MapSnapshot map("utias", VersionNumber(1), "", content);
  const Stamp begin = shift.run.scans.front().stamp;
  const Se2 T_start = Interpolate(shift.truth, begin, kMaxTruthGap).value();
  HypothesisOptions bank_options;
  bank_options.alpha = options.alpha;
  HypothesisBank bank(map, bank_options, DrawStart(T_start, options, seed), begin);
  OdometryBuffer odometry(map.calibration().odometry);
  std::map<Signature, int> seen;
  Drive drive;
  double squared = 0.0;
  int poses = 0;
  std::size_t next = 0;
  const Duration lag = FromSeconds(1.0);
  for (const Scan& scan : shift.run.scans) {
    while (next < shift.run.odometry.size() && shift.run.odometry[next].stamp <= scan.stamp + lag) {
      odometry.Add(shift.run.odometry[next++]);
    }
    const OdometryBuffer::Motion motion = odometry.Take(scan.stamp);
    bank.Predict(motion.increment, motion.elapsed_s);
    Scan usable;
    usable.stamp = scan.stamp;
    for (const Observation& observation : scan.observations) {
      const bool again = std::any_of(
          usable.observations.begin(), usable.observations.end(), [&](const Observation& other) {
            return other.signature == observation.signature;
          });
      if (again || map.GroupIndex(observation.signature) < 0) continue;
      usable.observations.push_back(Corrected(observation, map.calibration().sensor));
      ++seen[observation.signature];
    }
    for (const auto& [decision, surprising] : bank.Correct(usable).decisions) {
      drive.decisions.push_back(decision);
      drive.observations.push_back(seen[decision.signature]);
    }
    if (ToSeconds(scan.stamp - begin) < options.settled_after_s) continue;
    const std::optional<Se2> truth = Interpolate(shift.truth, scan.stamp, kMaxTruthGap);
    if (!truth) continue;
    squared +=
        (bank.best().filter.T_map_vehicle().translation() - truth->translation()).squaredNorm();
    ++poses;
  }
  drive.rmse_m = std::sqrt(squared / std::max(poses, 1));
  return drive;
}

}  // namespace

MapContent LayoutMap(const std::vector<Layout>& layouts,
                     int stale,
                     const Calibration& calibration,
                     const LayoutOptions& options) {
  MapContent content;
  content.calibration = calibration;
  const Eigen::Matrix2d cov =
      Eigen::Matrix2d::Identity() * (options.sd_survey_m * options.sd_survey_m);
  std::vector<Eigen::Matrix2d> marginals;
  for (const auto& [signature, place] : layouts.front()) {
    std::vector<Eigen::Vector2d> places;
    const std::vector<int> states = StatesOf(layouts, signature, options.same_place_m, &places);
    const int stale_state = states[static_cast<std::size_t>(stale)];
    const auto modes = static_cast<int>(places.size());
    LandmarkGroup group;
    group.signature = signature;
    // Whatever is not the stale place is as likely as any other, `absent` among them.
    group.probabilities =
        Eigen::VectorXd::Constant(modes + 1, (1.0 - options.stale_probability) / modes);
    group.probabilities[stale_state] = options.stale_probability;
    for (int state = 1; state <= modes; ++state) {
      Mode& mode = group.modes.emplace_back();
      mode.number = ModeNumber(state);
      mode.p_map_landmark = places[static_cast<std::size_t>(state) - 1];
      mode.cov_p_map_landmark = cov;
      marginals.push_back(cov);
    }
    group.chain = ModeChain::Uniform(modes, 1e-7);
    content.groups.push_back(group);
  }
  content.covariance = JointCovariance(marginals, {});
  return content;
}

StatusOr<TrueShift> LoadUtiasShift(const std::string& data, int dataset, int robot, int layout) {
  UtiasOptions options;
  options.dataset_dir = data + "/MRCLAM_Dataset" + std::to_string(dataset);
  options.robot = robot;
  SHIFTMAP_ASSIGN_OR_RETURN(UtiasRun recorded, ReadUtias(options));
  TrueShift shift;
  shift.dataset = dataset;
  shift.layout = layout;
  SHIFTMAP_ASSIGN_OR_RETURN(shift.truth, ReadUtiasGroundtruth(options.dataset_dir, robot));
  shift.run = std::move(recorded.run);
  std::vector<Scan>& scans = shift.run.scans;
  const auto first = std::find_if(scans.begin(), scans.end(), [&](const Scan& scan) {
    return Interpolate(shift.truth, scan.stamp, kMaxTruthGap).has_value();
  });
  scans.erase(scans.begin(), first);
  if (scans.empty()) {
    return InvalidArgument("data set {}: no scan of robot {} has a true pose", dataset, robot);
  }
  return shift;
}

StatusOr<Calibration> MappedCalibration(const std::string& data) {
  std::vector<MapperInput> inputs;
  for (const int dataset : {1, 2}) {
    UtiasOptions options;
    options.dataset_dir = data + "/MRCLAM_Dataset" + std::to_string(dataset);
    SHIFTMAP_ASSIGN_OR_RETURN(UtiasRun recorded, ReadUtias(options));
    const std::string name = "set" + std::to_string(dataset);
    inputs.push_back({name, name, std::move(recorded.run)});
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const MapperResult result, BuildMap(inputs, std::nullopt, {}));
  return result.content.calibration;
}

UtiasShiftResult LocalizeUtias(const TrueShift& shift,
                               const std::vector<Layout>& layouts,
                               int stale,
                               const Calibration& calibration,
                               const LayoutOptions& options,
                               std::uint64_t seed) {
  const auto holds = static_cast<std::size_t>(shift.layout);
  const MapContent all = LayoutMap(layouts, stale, calibration, options);
  const MapContent oracle = LayoutMap({layouts[holds]}, 0, calibration, options);
  const MapContent old =
      LayoutMap({layouts[static_cast<std::size_t>(stale)]}, 0, calibration, options);
  const Drive drive = Localize(shift, all, options, seed);
  UtiasShiftResult result;
  result.rmse_m = drive.rmse_m;
  result.rmse_oracle_m = Localize(shift, oracle, options, seed).rmse_m;
  result.rmse_stale_m = Localize(shift, old, options, seed).rmse_m;
  std::map<Signature, int> first;
  for (std::size_t i = 0; i < drive.decisions.size(); ++i) {
    const Decision& decision = drive.decisions[i];
    std::vector<Eigen::Vector2d> places;
    const std::vector<int> states =
        StatesOf(layouts, decision.signature, options.same_place_m, &places);
    ++result.decisions;
    result.wrong += decision.mode != ModeNumber(states[holds]);
    first.try_emplace(decision.signature, drive.observations[i]);
  }
  std::vector<int> observations;
  for (const auto& [signature, count] : first) observations.push_back(count);
  result.median_observations =
      observations.empty() ? std::numeric_limits<double>::quiet_NaN() : Median(observations);
  return result;
}

}  // namespace shiftmap
