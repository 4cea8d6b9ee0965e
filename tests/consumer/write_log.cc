// SPDX-License-Identifier: Apache-2.0
// Writes a run log: one second of a robot that drives straight on towards a landmark.
#include <cstdio>

#include "mapstore/codec/run_log.h"

int main(int argc, char** argv) {
  const shiftmap::Stamp begin = shiftmap::StampFromSeconds(1767600000.0);
  auto log = shiftmap::RunLogWriter::Create(argc > 1 ? argv[1] : "run.mcap",
                                            {.vehicle = "agv-3", .source = "agv", .area = "hall"});
  if (!log.ok()) return 1;
  for (int i = 0; i < 20; ++i) {
    const shiftmap::Stamp stamp = begin + shiftmap::FromSeconds(0.05 * i);
    shiftmap::Observation seen;
    seen.signature = shiftmap::Signature("L07");
    seen.z = {8.0 - 0.05 * i, 0.0};  // Range and bearing.
    shiftmap::Status status = log->Write(shiftmap::OdometrySample{stamp, 1.0, 0.0});
    if (status.ok()) status = log->Write(shiftmap::Scan{stamp, {seen}});
    if (!status.ok()) std::fprintf(stderr, "%s\n", status.ToString().c_str());
  }
  return log->Finish().ok() ? 0 : 1;
}
