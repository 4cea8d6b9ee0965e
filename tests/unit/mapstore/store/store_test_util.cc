// SPDX-License-Identifier: Apache-2.0
#include "tests/unit/mapstore/store/store_test_util.h"

#include <utility>

#include "proto/core/check.h"

namespace shiftmap::testing {

MapStore OpenStore(const std::string& path) {
  StatusOr<MapStore> store = MapStore::Open(path, MapStore::Access::kReadWriteCreate);
  SHIFTMAP_CHECK(store.ok(), "{}", Message(store.status()));
  return *std::move(store);
}

MapContent TwoStateContent(double leave_rate_per_s, double probability, Stamp stamp) {
  LandmarkGroup group;
  group.signature = Signature("A");
  Mode mode;
  mode.number = ModeNumber(1);
  mode.cov_p_map_landmark = 0.01 * Eigen::Matrix2d::Identity();
  group.modes = {mode};
  group.chain = ModeChain::Uniform(1, leave_rate_per_s);
  group.probabilities = Eigen::Vector2d(1.0 - probability, probability);
  MapContent content;
  content.groups = {group};
  content.covariance = JointCovariance({mode.cov_p_map_landmark}, {});
  content.stamp = stamp;
  return content;
}

ShiftReport EmptyReport(const CommitResult& version, const std::string& area, int number) {
  ShiftReport report;
  report.uuid = fmt::format("00000000-0000-4000-8000-{:012}", number);
  report.vehicle = "truck 1";
  report.area = area;
  report.version = version.version;
  report.content_hash = version.content_hash;
  report.software = "test";
  report.begin = At(-1e6 + 1e-3 * number);
  report.end = At(1e6);
  return report;
}

VisitEvidence TwoStateEvidence(Stamp begin, Stamp end, double absent, double mode) {
  VisitEvidence evidence;
  evidence.signature = Signature("A");
  evidence.begin = begin;
  evidence.end = end;
  evidence.modes = {{kAbsent, absent}, {ModeNumber(1), mode}};
  evidence.observations = 1;
  return evidence;
}

Stamp At(double seconds) {
  return StampFromNanoseconds(1'700'000'000'000'000'000) + FromSeconds(seconds);
}

}  // namespace shiftmap::testing
