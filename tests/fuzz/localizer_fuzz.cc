// SPDX-License-Identifier: Apache-2.0
//
// Localizes a run that the input has edited. Whatever the items say, the pose stays finite and the
// shift ends with a valid report.
#include "localizer/localizer.h"

#include <cmath>

#include "localizer/initialization/start_pose.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/map/shift_report_check.h"
#include "proto/core/check.h"
#include "tests/fuzz/fuzz_run.h"
#include "tests/fuzz/fuzz_target.h"

namespace shiftmap::testing {
namespace {

void CheckPose(const Localizer& localizer) {
  const auto estimate = localizer.Estimate();
  if (!estimate) return;
  const PoseWithCovariance& pose = estimate->pose;
  SHIFTMAP_CHECK(pose.T_map_vehicle.translation().allFinite() &&
                     std::isfinite(pose.T_map_vehicle.yaw()) &&
                     IsSymmetricPositiveDefinite(pose.cov_T_map_vehicle),
                 "a pose that is none");
  SHIFTMAP_CHECK(estimate->quality >= 0.0 && estimate->quality <= 1.0, "quality");
}

void CheckReport(ShiftReport report) {
  report.uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
  report.vehicle = "truck";
  report.content_hash = std::string(64, 'a');
  report.software = "fuzz";
  LeaveOutInvalid(&report);
  const auto decoded = DecodeShiftReport(EncodeShiftReport(report));
  SHIFTMAP_CHECK(decoded.ok(), "{}", Message(decoded.status()));
}

}  // namespace

std::vector<std::string> FuzzSeeds() {
  std::vector<std::string> seeds;
  for (const char options : {'\0', '\3', '\6'}) {
    for (const std::string& edit : EditSeeds()) seeds.push_back(options + edit);
  }
  return seeds;
}

void RunFuzzInput(std::string_view bytes) {
  static const FuzzWorld world;
  FuzzInput input(bytes);
  const std::uint64_t choice = input.Take(1);
  LocalizerOptions options;
  if ((choice & 1U) != 0) options.max_delay_s = 0.2;
  if ((choice & 2U) != 0) options.initial_pose = {Se2(), Eigen::Matrix3d::Identity() * 0.01};
  if ((choice & 4U) != 0) {
    options.hypotheses.field_of_view.model = FieldOfViewModel::kScanPolygon;
  }
  Localizer localizer(MapSnapshot("area", VersionNumber(1), std::string(64, 'a'), world.content),
                      options);
  std::vector<RunEvent> events = world.events;
  EditEvents(&input, &events);
  for (const RunEvent& event : events) {
    localizer.Process(event).IgnoreError();
    CheckPose(localizer);
  }
  if (!input.empty()) {
    const PoseWithCovariance pose = TakePose(&input);
    if (ValidateStart(pose).ok()) localizer.Initialize(pose);
    for (const RunEvent& event : world.events) {
      localizer.Process(event).IgnoreError();
      CheckPose(localizer);
    }
  }
  localizer.Finish();
  CheckReport(localizer.Report());
}

}  // namespace shiftmap::testing
