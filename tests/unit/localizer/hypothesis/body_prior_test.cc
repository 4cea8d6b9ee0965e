// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/body_prior.h"

#include <gtest/gtest.h>

#include <functional>

#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap {
namespace {

constexpr double kGrid = 0.05;  // [m]

// Landmarks with one mode each, in front of a vehicle at the origin that knows its pose.
MapContent Map() {
  const Eigen::Vector2d places[] = {{4.0, 0.0}, {5.0, 1.0}, {4.0, -6.0}};
  MapContent content = MakeTwoModeMap(3, 10.0, 1);
  std::vector<Eigen::Matrix2d> marginals;
  for (std::size_t i = 0; i < content.groups.size(); ++i) {
    LandmarkGroup& group = content.groups[i];
    group.modes.resize(1);
    group.modes[0].p_map_landmark = places[i];
    group.modes[0].cov_p_map_landmark = 1e-4 * Eigen::Matrix2d::Identity();
    group.chain = ModeChain::Uniform(1, 1e-6);
    group.probabilities = Eigen::Vector2d(0.03, 0.97);
    marginals.push_back(group.modes[0].cov_p_map_landmark);
  }
  content.covariance = JointCovariance(marginals, {});
  return content;
}

KnownMapFilter::Measurement SeenAt(const Eigen::Vector2d& q) {
  Observation observation;
  observation.kind = Observation::Kind::kCartesian;
  observation.z = q;
  return KnownMapFilter::Measure(observation, 0.0025 * Eigen::Matrix2d::Identity());
}

class BodyPriorTest : public testing::Test {
 protected:
  BodyPriorTest()
      : content_(Map()),
        map_(Snapshot(content_)),
        filter_({Se2(), 1e-6 * Eigen::Matrix3d::Identity()}, content_.calibration) {}

  double At(int group, const Eigen::Vector2d& q, const MovedLandmarks& moved) const {
    return DensityWithOthers(map_, filter_, group, SeenAt(q), moved);
  }

  // Over a square of 2 `half` about `middle`.
  double Integral(const Eigen::Vector2d& middle,
                  double half,
                  const std::function<double(const Eigen::Vector2d&)>& density) const {
    double sum = 0.0;
    for (double x = -half; x < half; x += kGrid) {
      for (double y = -half; y < half; y += kGrid) sum += density(middle + Eigen::Vector2d(x, y));
    }
    return sum * kGrid * kGrid;
  }

  MapContent content_;
  MapSnapshot map_;
  KnownMapFilter filter_;
};

TEST_F(BodyPriorTest, ALandmarkGoesAlongWithNOthersWithNOverNPlusOne) {
  const Eigen::Vector2d moved_by(0.0, 2.0);
  const Eigen::Vector2d mode = content_.groups[0].modes[0].p_map_landmark;
  MovedLandmarks moved;
  for (int other = 1; other <= 2; ++other) {
    const LandmarkGroup& group = content_.groups[static_cast<std::size_t>(other)];
    filter_.StartPlace(
        other, SeenAt(group.modes[0].p_map_landmark + moved_by), Eigen::Vector2d::Zero());
    moved.clear();
    for (int group_index = 1; group_index <= other; ++group_index) {
      moved.push_back({filter_.FindPlace(group_index), 1.0});
    }
    const auto with_others = [&](const Eigen::Vector2d& q) { return At(0, q, moved); };
    EXPECT_NEAR(Integral(mode + moved_by, 8.0, with_others), other / (other + 1.0), 0.02);
    EXPECT_GT(with_others(mode + moved_by), 100.0 * with_others(mode));
  }
}

}  // namespace
}  // namespace shiftmap
