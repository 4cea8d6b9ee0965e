// SPDX-License-Identifier: Apache-2.0
//
// Decodes the input, without its first byte, as the message of a recording that the byte picks. One
// that is accepted survives encoding.
#include "localizer/recording/codec/recording_codec.h"

#include "proto/core/check.h"
#include "tests/fuzz/fuzz_target.h"

namespace shiftmap::testing {
namespace {

template <typename Value>
void CheckRoundTrip(std::string_view bytes) {
  Value value;
  if (!Decode(bytes, &value).ok()) return;
  const std::string encoded = Encode(value);
  Value again;
  const Status status = Decode(encoded, &again);
  SHIFTMAP_CHECK(status.ok(), "{}", Message(status));
  SHIFTMAP_CHECK(Encode(again) == encoded, "another encoding");
}

}  // namespace

std::vector<std::string> FuzzSeeds() {
  const Stamp stamp = StampFromSeconds(1.0e9);
  StateChange change;
  change.stamp = stamp;
  change.to = LocalizerState::kModeChanged;
  change.evidence.signature = Signature("L1");
  const DecisionChange decision{stamp, {Signature("L1"), ModeNumber(2), stamp, 9.5}, true};
  const ScanInnovations scan{
      stamp,
      0.5,
      {{Signature("L1"), ModeNumber(1), {0.1, 0.2}, Eigen::Matrix2d::Identity(), 0.05}}};
  HypothesesSample sample{stamp, {}, {0.9, 0.1}};
  sample.view.nodes.resize(2);
  sample.view.nodes[1].parent = 0;
  sample.view.nodes[1].T_map_vehicle = Se2(1.0, 2.0, 3.0);
  sample.view.visits.push_back({Signature("L1"), stamp, 3, ModeNumber(1), {{kAbsent, 0.1}}});
  return {"0" + Encode(RecordedShift{"v", "a", VersionNumber(1), "c", "r", "s", ""}),
          "1" + Encode(live::PoseEvent{stamp, {}, LocalizerState::kTracking}),
          "2" + Encode(change),
          "3" + Encode(decision),
          "4" + Encode(scan),
          "5" + Encode(sample)};
}

void RunFuzzInput(std::string_view bytes) {
  if (bytes.empty()) return;
  const std::string_view message = bytes.substr(1);
  switch (static_cast<unsigned char>(bytes.front()) % 6) {
    case 0:
      return CheckRoundTrip<RecordedShift>(message);
    case 1:
      return CheckRoundTrip<live::PoseEvent>(message);
    case 2:
      return CheckRoundTrip<StateChange>(message);
    case 3:
      return CheckRoundTrip<DecisionChange>(message);
    case 4:
      return CheckRoundTrip<ScanInnovations>(message);
    default:
      return CheckRoundTrip<HypothesesSample>(message);
  }
}

}  // namespace shiftmap::testing
