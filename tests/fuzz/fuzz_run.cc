// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/fuzz_run.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap::testing {
namespace {

enum EditKind : std::size_t {
  kNumbers,
  kObservation,
  kErase,
  kMove,
  kRepeat,
  kStuck,
  kEnd,
  kLidar,
  kKinds
};

constexpr int kGroups = 12;

Observation TakeObservation(FuzzInput* input) {
  Observation observation;
  const std::size_t name = input->Index(kGroups + 3);
  if (name > 0) observation.signature = Signature(std::to_string(99 + name));
  observation.kind =
      input->Index(2) == 0 ? Observation::Kind::kRangeBearing : Observation::Kind::kCartesian;
  observation.z.x() = input->Number();
  observation.z.y() = input->Number();
  if (input->Index(4) == 3) {
    Eigen::Matrix2d covariance;
    covariance(0, 0) = input->Number();
    covariance(1, 1) = input->Number();
    covariance(0, 1) = covariance(1, 0) = input->Number();
    observation.cov_z = covariance;
  }
  return observation;
}

LidarScan TakeLidarScan(Stamp stamp, FuzzInput* input) {
  LidarScan scan;
  scan.stamp = stamp;
  scan.sensor.field_of_view_rad = input->Number();
  scan.sensor.max_range_m = input->Number();
  const double x_m = input->Number();
  scan.sensor.T_vehicle_lidar = Se2(x_m, 0.0, input->Number());
  for (std::uint64_t beams = input->Take(1); beams > 0; --beams) {
    scan.ranges_m.push_back(static_cast<float>(input->Number()));
  }
  return scan;
}

void SetNumbers(FuzzInput* input, RunEvent* event) {
  if (auto* sample = std::get_if<OdometrySample>(event)) {
    sample->v_mps = input->Number();
    sample->omega_radps = input->Number();
    return;
  }
  auto* scan = std::get_if<Scan>(event);
  if (scan == nullptr || scan->observations.empty()) return;
  auto& observations = scan->observations;
  Observation& observation = observations[input->Index(observations.size())];
  observation.z.x() = input->Number();
  observation.z.y() = input->Number();
}

void SetStamp(Stamp stamp, RunEvent* event) {
  std::visit([&](auto& item) { item.stamp = stamp; }, *event);
}

// From an item on, all say they are later or earlier.
void Move(FuzzInput* input, std::size_t from, std::vector<RunEvent>* events) {
  const FuzzInput step = *input;
  for (std::size_t i = from; i < events->size(); ++i) {
    FuzzInput same = step;
    SetStamp(same.Moved(StampOf((*events)[i])), &(*events)[i]);
    if (i == from) *input = same;
  }
}

void Stick(FuzzInput* input, std::size_t from, std::vector<RunEvent>* events) {
  const double v = input->Number();
  const double omega = input->Number();
  for (std::size_t i = from; i < events->size(); ++i) {
    auto* sample = std::get_if<OdometrySample>(&(*events)[i]);
    if (sample != nullptr) *sample = {sample->stamp, v, omega};
  }
}

std::string Edit(std::size_t at, EditKind kind) {
  return {static_cast<char>(at / 256), static_cast<char>(at % 256), static_cast<char>(kind)};
}

}  // namespace

FuzzWorld::FuzzWorld() : content(MakeTwoModeMap(kGroups, 10.0, 3)) {
  SimulationOptions options;
  options.duration_s = 20.0;
  events = MergeEvents(
      Simulate(content, PositionsOf(content, std::vector<int>(kGroups, 1)), options).run);
}

void EditEvents(FuzzInput* input, std::vector<RunEvent>* events) {
  constexpr int kMaxEdits = 16;
  for (int edits = 0; edits < kMaxEdits && !input->empty() && !events->empty(); ++edits) {
    const std::size_t at = input->Take(2) % events->size();
    const auto item = events->begin() + static_cast<std::ptrdiff_t>(at);
    switch (input->Index(kKinds)) {
      case kNumbers:
        SetNumbers(input, &*item);
        break;
      case kObservation:
        if (auto* scan = std::get_if<Scan>(&*item))
          scan->observations.push_back(TakeObservation(input));
        break;
      case kErase:
        events->erase(item,
                      item + static_cast<std::ptrdiff_t>(
                                 std::min<std::size_t>(input->Take(1), events->size() - at)));
        break;
      case kMove:
        Move(input, at, events);
        break;
      case kRepeat:
        events->insert(item, RunEvent(*item));
        break;
      case kStuck:
        Stick(input, at, events);
        break;
      case kLidar:
        events->insert(item, TakeLidarScan(StampOf(*item), input));
        break;
      default:
        return;
    }
  }
}

PoseWithCovariance TakePose(FuzzInput* input) {
  PoseWithCovariance pose;
  const double x = input->Number();
  const double y = input->Number();
  pose.T_map_vehicle = Se2(x, y, input->Number());
  for (int i = 0; i < 3; ++i) pose.cov_T_map_vehicle(i, i) = input->Number();
  return pose;
}

std::vector<std::string> EditSeeds() {
  // Five samples and a scan take turns; here the vehicle knows where it is.
  constexpr std::size_t kSample = 384;
  constexpr std::size_t kScan = 385;
  std::vector<std::string> seeds = {""};
  for (std::size_t i = 0; i < std::size(kExtremes); ++i) {
    const std::string number = ExtremeNumber(i);
    const std::string zero = ExtremeNumber(0);
    seeds.push_back(Edit(kScan, kNumbers) + std::string(1, '\0') + number + zero);
    seeds.push_back(Edit(kSample, kNumbers) + number + zero);
    seeds.push_back(Edit(kSample, kStuck) + zero + number);
    for (const char name : {'\0', '\3', '\x0a'}) {
      seeds.push_back(Edit(kScan, kObservation) + std::string{name, '\0'} + number + zero + '\0');
      seeds.push_back(Edit(kScan, kObservation) + std::string{name, '\1'} + number + number + '\0');
      seeds.push_back(Edit(kScan, kObservation) + std::string{name, '\1'} + zero + zero + '\3' +
                      number + number + zero);
    }
  }
  // A lidar of three beams, of which something is extreme.
  const std::string one = ExtremeNumber(2);
  for (std::size_t i = 0; i < std::size(kExtremes); ++i) {
    const std::string number = ExtremeNumber(i);
    const std::string lidar = Edit(kScan, kLidar);
    seeds.push_back(lidar + one + one + number + number + '\3' + one + number + one);
    seeds.push_back(lidar + number + number + one + one + '\3' + one + one + number);
  }
  for (const char unit : {'\0', '\1', '\2', '\3', '\4'}) {
    for (const char count : {'\x01', '\x7f', '\x80', '\xff'}) {
      seeds.push_back(Edit(kSample, kMove) + std::string{unit, count, count});
    }
  }
  return seeds;
}

}  // namespace shiftmap::testing
