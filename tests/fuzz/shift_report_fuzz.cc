// SPDX-License-Identifier: Apache-2.0
//
// Decodes the input as a shift report, alone and behind a valid one: Protobuf merges what is
// concatenated, so that the input then adds rows to a report whose head is right. A report that is
// accepted must survive encoding unchanged.
#include "mapstore/codec/shift_report.h"

#include "proto/core/check.h"
#include "tests/fuzz/fuzz_target.h"

namespace shiftmap::testing {
namespace {

ShiftReport ValidHead() {
  ShiftReport report;
  report.uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
  report.vehicle = "truck";
  report.area = "level";
  report.version = VersionNumber(1);
  report.content_hash = std::string(64, 'a');
  report.software = "fuzz";
  report.begin = StampFromSeconds(0.0);
  report.end = StampFromSeconds(4.0e9);
  return report;
}

void Decode(const std::string& bytes) {
  const auto report = DecodeShiftReport(bytes);
  if (!report.ok()) return;
  const std::string encoded = EncodeShiftReport(*report);
  const auto again = DecodeShiftReport(encoded);
  SHIFTMAP_CHECK(again.ok(), "{}", Message(again.status()));
  SHIFTMAP_CHECK(EncodeShiftReport(*again) == encoded, "another encoding");
}

}  // namespace

std::vector<std::string> FuzzSeeds() {
  ShiftReport report = ValidHead();
  std::vector<std::string> seeds = {"", EncodeShiftReport(report)};
  for (const double number : {-1.0, 1e-300, 1e300}) {
    report.evidence = {{Signature("17"),
                        report.begin,
                        report.end,
                        {{kAbsent, number}, {ModeNumber(1), -number}},
                        INT64_MAX}};
    report.decisions = {{Signature("17"), ModeNumber(INT64_MAX), report.end, number}};
    const double variance = std::abs(number);
    report.sightings = {{Signature("18"),
                         {number, -number},
                         Eigen::Matrix2d::Identity() * variance,
                         INT64_MAX,
                         report.begin,
                         report.end}};
    report.dropped = {{"late", INT64_MAX}};
    seeds.push_back(EncodeShiftReport(report));
  }
  return seeds;
}

void RunFuzzInput(std::string_view bytes) {
  static const std::string head = EncodeShiftReport(ValidHead());
  Decode(std::string(bytes));
  Decode(head + std::string(bytes));
}

}  // namespace shiftmap::testing
