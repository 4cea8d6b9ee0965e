// SPDX-License-Identifier: Apache-2.0
//
// Counts what a step takes from the heap. Eigen allocates by malloc and everything else by way of
// it, so malloc itself is counted; not under sanitizers, which have their own.
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <utility>
#include <vector>

#include "localizer/localizer.h"
#include "tests/unit/localizer/simulated_run.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SHIFTMAP_COUNTS_ALLOCATIONS 0
#else
#define SHIFTMAP_COUNTS_ALLOCATIONS 1
#endif

namespace {

std::int64_t allocations = 0;
std::int64_t bytes_in_use = 0;

[[maybe_unused]] void* Counted(void* memory) {
  ++allocations;
  bytes_in_use += static_cast<std::int64_t>(malloc_usable_size(memory));
  return memory;
}

}  // namespace

#if SHIFTMAP_COUNTS_ALLOCATIONS
extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* memory, std::size_t size);
void __libc_free(void* memory);

void* malloc(std::size_t size) { return Counted(__libc_malloc(size)); }
void* calloc(std::size_t count, std::size_t size) { return Counted(__libc_calloc(count, size)); }
void* realloc(void* memory, std::size_t size) {
  bytes_in_use -= static_cast<std::int64_t>(malloc_usable_size(memory));
  return Counted(__libc_realloc(memory, size));
}
void free(void* memory) {
  bytes_in_use -= static_cast<std::int64_t>(malloc_usable_size(memory));
  __libc_free(memory);
}
}
#endif

namespace shiftmap {
namespace {

class AllocationTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!SHIFTMAP_COUNTS_ALLOCATIONS) GTEST_SKIP() << "a sanitizer has the heap";
  }

  static LocalizerOptions Options(double max_delay_s) {
    LocalizerOptions options;
    options.hypotheses.max_leaves = 8;
    options.max_delay_s = max_delay_s;
    options.initial_pose =
        PoseWithCovariance{Se2(), Eigen::Vector3d(0.04, 0.04, 0.0025).asDiagonal()};
    return options;
  }
};

// What Process() took, summed over the events.
std::int64_t AllocationsOf(const std::vector<RunEvent>& events,
                           std::size_t begin,
                           std::size_t end,
                           Localizer* localizer) {
  std::int64_t sum = 0;
  for (std::size_t i = begin; i < end; ++i) {
    const std::int64_t before = allocations;
    const bool ok = localizer->Process(events[i]).ok();
    sum += allocations - before;
    EXPECT_TRUE(ok);
  }
  return sum;
}

std::vector<RunEvent> Rounds(const MapContent& content, double duration_s) {
  SimulationOptions simulation;
  simulation.duration_s = duration_s;
  const std::vector<int> states(content.groups.size(), 2);
  return MergeEvents(Simulate(content, PositionsOf(content, states), simulation).run);
}

// Back and forth by 20 cm before landmarks well inside the field of view, one in five missed.
std::vector<RunEvent> BackAndForth(const MapContent& content, int scans) {
  constexpr double kPeriod = 0.05;
  constexpr int kScansPerTurn = 20;
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  // No outliers: what gates with no mode is recorded as a sighting.
  const auto noise = [&] { return std::clamp(normal(random), -2.0, 2.0); };
  const SensorCalibration& sensor = content.calibration.sensor;
  std::vector<RunEvent> events;
  double x_m = 0.0;
  for (int i = 0; i < scans; ++i) {
    Scan scan;
    scan.stamp = StampFromSeconds(1000.0 + kPeriod * i);
    for (const LandmarkGroup& group : content.groups) {
      const Eigen::Vector2d q = group.modes[1].p_map_landmark - Eigen::Vector2d(x_m, 0.0);
      const Eigen::Vector2d z(q.norm(), std::atan2(q.y(), q.x()));
      const bool inside = z.x() > 2.0 && z.x() < 0.8 * sensor.max_range_m &&
                          std::abs(z.y()) < 0.8 * sensor.max_bearing_rad;
      if (!inside || uniform(random) < 0.2) continue;
      Observation& observation = scan.observations.emplace_back();
      observation.signature = group.signature;
      observation.z =
          z + Eigen::Vector2d(sensor.sd_range_m * noise(), sensor.sd_bearing_rad * noise());
    }
    const double v_mps = i / kScansPerTurn % 2 == 0 ? 0.2 : -0.2;
    events.emplace_back(OdometrySample{scan.stamp, v_mps, 0.0});
    events.emplace_back(std::move(scan));
    x_m += v_mps * kPeriod;
  }
  return events;
}

// Puts a lidar's scan of open ground before every fourth scan.
std::vector<RunEvent> WithLidar(const std::vector<RunEvent>& events) {
  constexpr int kScansPerLidar = 4;
  std::vector<RunEvent> with;
  int scans = 0;
  for (const RunEvent& event : events) {
    if (std::holds_alternative<Scan>(event) && scans++ % kScansPerLidar == 0) {
      LidarScan scan;
      scan.stamp = StampOf(event);
      scan.ranges_m.assign(361, 20.0f);
      with.emplace_back(std::move(scan));
    }
    with.push_back(event);
  }
  return with;
}

TEST_F(AllocationTest, SteadyStreamTakesNothing) {
  const MapContent content = MakeTwoModeMap(80, 16.0, 3);
  const std::vector<RunEvent> odometry_and_scans = BackAndForth(content, 2000);
  for (const auto& [max_delay_s, with_lidar] :
       {std::pair(0.0, false), {0.2, false}, {0.0, true}, {0.2, true}}) {
    const std::vector<RunEvent> events =
        with_lidar ? WithLidar(odometry_and_scans) : odometry_and_scans;
    LocalizerOptions options = Options(max_delay_s);
    if (with_lidar) options.hypotheses.field_of_view.model = FieldOfViewModel::kScanPolygon;
    Localizer localizer(Snapshot(content), options);
    const std::size_t warm = events.size() / 2;
    AllocationsOf(events, 0, warm, &localizer);
    const std::int64_t updates = localizer.Statistics().updates;
    const std::size_t records = localizer.Report().evidence.size() + localizer.decisions().size();
    const std::int64_t taken = AllocationsOf(events, warm, events.size(), &localizer);
    EXPECT_GT(localizer.Statistics().updates, updates + 1000);
    EXPECT_EQ(localizer.Report().evidence.size() + localizer.decisions().size(), records);
    EXPECT_EQ(taken, 0) << max_delay_s << ", " << with_lidar;
    EXPECT_EQ(localizer.Statistics().scans_by_lidar > 1900, with_lidar);
  }
}

// More landmarks than SharedErrors hold, on a correlated map, and one of them has moved.
TEST_F(AllocationTest, ALandmarkThatMovedTakesNothingFromTheHeap) {
  constexpr int kGroups = SharedErrors::kMaxModes + 4;
  MapContent content = MakeTwoModeMap(kGroups, 12.0, 3);
  const Eigen::Index size = 2 * content.covariance.size();
  const Eigen::MatrixXd of_all = Eigen::MatrixXd::Identity(size, size) * 0.01;
  SetCovariance(JointCovariance::FromDense(of_all + Eigen::MatrixXd::Constant(size, size, 1e-4)),
                &content);
  const MapSnapshot snapshot = Snapshot(content);
  KnownMapFilter filter(*Options(0.0).initial_pose, content.calibration);
  std::int64_t taken = 0;
  int by_place = 0;
  for (int i = 0; i < 40 * kGroups; ++i) {
    const int group = i % kGroups;
    const LandmarkGroup& landmark = content.groups[static_cast<std::size_t>(group)];
    Observation seen;
    seen.kind = Observation::Kind::kCartesian;
    seen.z = landmark.modes[0].p_map_landmark;
    if (group == 0) seen.z += Eigen::Vector2d(1.0, 1.0);
    const KnownMapFilter::Measurement measurement =
        KnownMapFilter::Measure(seen, 0.01 * Eigen::Matrix2d::Identity());
    const std::int64_t before = allocations;
    const UnknownPlace* const place = filter.FindPlace(0);
    if (group > 0) {
      const ModeRef mode{group, 1};
      filter.Update(filter.PredictObservation(measurement, filter.PredictPoint(mode, snapshot)),
                    mode,
                    snapshot);
    } else if (place == nullptr) {
      filter.StartPlace(0, measurement, Eigen::Vector2d::Zero());
    } else {
      filter.UpdatePlace(*place, filter.PredictPlace(*place, measurement), snapshot, 1.0, true);
      ++by_place;
    }
    taken += allocations - before;
  }
  EXPECT_EQ(taken, 0);
  EXPECT_EQ(by_place, 39);
}

// Rounds through changing views: visits open and end, and only their records stay.
TEST_F(AllocationTest, MemoryGrowsByTheRecordsAlone) {
  const MapContent content = MakeTwoModeMap(60, 20.0, 3);
  const std::vector<RunEvent> events = Rounds(content, 240.0);
  Localizer localizer(Snapshot(content), Options(0.0));
  const std::size_t warm = events.size() / 2;
  AllocationsOf(events, 0, warm, &localizer);
  const std::size_t before = localizer.Report().evidence.size();
  const std::int64_t bytes = bytes_in_use;
  AllocationsOf(events, warm, events.size(), &localizer);
  const std::int64_t grown = bytes_in_use - bytes;
  const std::size_t ended = localizer.Report().evidence.size() - before;
  ASSERT_GT(ended, 50u);
  // A record, its values, and what the list of them has in reserve.
  constexpr std::int64_t kBytesPerVisit = 600;
  EXPECT_LT(grown, kBytesPerVisit * static_cast<std::int64_t>(ended));
  RecordProperty("bytes_per_visit", static_cast<int>(grown / static_cast<std::int64_t>(ended)));
}

}  // namespace
}  // namespace shiftmap
