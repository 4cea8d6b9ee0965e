// SPDX-License-Identifier: Apache-2.0
//
// Decodes the input as a shift report, alone and behind a valid one: Protobuf merges what is
// concatenated, so that the input then adds rows to a report whose head is right. A report that is
// accepted must survive encoding unchanged.
#include <string>

#include "mapstore/codec/shift_report.h"
#include "proto/core/check.h"

namespace {

std::string ValidHead() {
  shiftmap::ShiftReport report;
  report.uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
  report.vehicle = "truck";
  report.area = "level";
  report.version = shiftmap::VersionNumber(1);
  report.content_hash = std::string(64, 'a');
  report.software = "fuzz";
  report.begin = shiftmap::Stamp::min();
  report.end = shiftmap::Stamp::max();
  return shiftmap::EncodeShiftReport(report);
}

void Decode(const std::string& bytes) {
  const auto report = shiftmap::DecodeShiftReport(bytes);
  if (!report.ok()) return;
  const std::string encoded = shiftmap::EncodeShiftReport(*report);
  const auto again = shiftmap::DecodeShiftReport(encoded);
  SHIFTMAP_CHECK(again.ok(), "{}", shiftmap::Message(again.status()));
  SHIFTMAP_CHECK(shiftmap::EncodeShiftReport(*again) == encoded, "another encoding");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const unsigned char* bytes, std::size_t size) {
  static const std::string head = ValidHead();
  const std::string input(reinterpret_cast<const char*>(bytes), size);
  Decode(input);
  Decode(head + input);
  return 0;
}
