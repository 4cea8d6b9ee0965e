// SPDX-License-Identifier: Apache-2.0
//
// Takes the input apart as a socket does, decodes what comes out as a request, an event and a
// record of a journal, and as a saved pose. How the stream is cut makes no difference, and what is
// accepted survives encoding.
#include "localizer/live/codec/journal_codec.h"
#include "localizer/live/codec/live_codec.h"
#include "localizer/live/framing.h"
#include "proto/core/check.h"
#include "tests/fuzz/fuzz_target.h"

namespace shiftmap::testing {
namespace {

using live::FrameReader;

std::vector<std::string> Frames(std::string_view bytes, std::size_t piece) {
  FrameReader reader;
  std::vector<std::string> frames;
  for (;;) {
    for (;;) {
      auto next = reader.Next();
      if (!next.ok()) return frames;
      if (!next->has_value()) break;
      frames.push_back(**std::move(next));
    }
    if (bytes.empty()) return frames;
    reader.Append(bytes.substr(0, piece));
    bytes.remove_prefix(std::min(piece, bytes.size()));
  }
}

// Decodes; what is accepted is encoded to the same bytes ever after.
template <typename Decode, typename Encode>
void CheckRoundTrip(std::string_view bytes, const Decode& decode, const Encode& encode) {
  const auto value = decode(bytes);
  if (!value.ok()) return;
  const std::string encoded = encode(*value);
  const auto again = decode(std::string_view(encoded));
  SHIFTMAP_CHECK(again.ok(), "{}", Message(again.status()));
  SHIFTMAP_CHECK(encode(*again) == encoded, "another encoding");
}

void DecodeAll(std::string_view bytes) {
  const auto request = [](std::string_view message) {
    std::uint64_t id = 0;
    return live::DecodeRequest(message, &id);
  };
  CheckRoundTrip(bytes, request, live::EncodeRequest);
  CheckRoundTrip(bytes, live::DecodeEvent, live::EncodeEvent);
  CheckRoundTrip(bytes, live::DecodeJournalRecord, live::EncodeJournalRecord);
  CheckRoundTrip(bytes, live::DecodeSavedPose, live::EncodeSavedPose);
  CheckRoundTrip(bytes, live::DecodeActionStates, live::EncodeActionStates);
}

PoseWithCovariance Pose(double number) {
  return {Se2(number, -number, 1.0), Eigen::Matrix3d::Identity() * number};
}

std::vector<live::Request> Requests(double number) {
  const Stamp stamp = StampFromSeconds(1.0e9);
  const Scan scan{
      stamp, {{Signature("17"), Observation::Kind::kRangeBearing, {number, number}, std::nullopt}}};
  return {{1, OdometrySample{stamp, number, -number}},
          {UINT64_MAX, scan},
          {8, LidarScan{stamp, {}, {1.0f, 0.0f, 2.0f}}},
          {2, live::GetState{.hypotheses = true}},
          {3, live::Start{.vehicle = "truck", .odometer_m = number}},
          {4, live::Stop{.save_pose = true}},
          {5, live::SetMap{"area", VersionNumber(INT64_MAX), "hash"}},
          {6, live::InitializePose{Pose(number)}},
          {7, live::Subscribe{true, true, true, true, true}},
          {9, live::DownloadMap{{"a", "area", "1-0-0"}, "https://maps/1.db", "hash"}},
          {10, live::EnableMap{{"a", "area", "1-0-0"}}},
          {11, live::DeleteMap{{"", "area", "1-0-0"}}},
          {12, live::InitializePosition{"a", "area", Pose(number), true}},
          {13, live::ClearActions()},
          {14, live::GetFleetState()},
          {15, live::MapDownloadProgress{"a", true, NotFound("no such file")}}};
}

live::FleetState Fleet(double number) {
  live::FleetState state;
  state.maps = {{"area", "1-0-0", true}};
  state.map_id = "area";
  state.T_map_vehicle = Se2(number, -number, 1.0);
  state.localized = true;
  state.localization_score = 0.5;
  state.deviation_range_m = number;
  state.errors = {{"DUPLICATE_MAP", "WARNING", "text", {{"mapId", "area"}}}};
  state.actions = {{"a", "downloadMap", live::ActionStatus::kFailed, "text"}};
  return state;
}

}  // namespace

std::vector<std::string> FuzzSeeds() {
  const Stamp stamp = StampFromSeconds(1.0e9);
  std::vector<std::string> seeds = {"", "\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01"};
  for (const double number : {1.0, 1e-9, 1e9}) {
    std::string stream;
    for (const live::Request& request : Requests(number)) {
      const std::string message = live::EncodeRequest(request);
      seeds.push_back(message);
      stream += live::Framed(message);
    }
    seeds.push_back(stream);
    live::ShiftHeader header;
    header.uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
    header.vehicle = "truck";
    header.area = "area";
    header.version = VersionNumber(1);
    header.content_hash = std::string(64, 'a');
    header.odometer_m = number;
    seeds.push_back(live::EncodeJournalRecord(header));
    seeds.push_back(live::EncodeSavedPose({"area", "hash", stamp, Pose(number), number}));
    live::ServiceState state;
    state.dropped = {{"late", INT64_MAX}};
    state.pose = Pose(number);
    seeds.push_back(live::EncodeEvent(live::Reply{1, OkStatus(), state}));
    seeds.push_back(live::EncodeEvent(live::PoseEvent{stamp, Pose(number)}));
    live::Reply reply;
    reply.fleet_state = Fleet(number);
    seeds.push_back(live::EncodeEvent(reply));
    seeds.push_back(live::EncodeActionStates(reply.fleet_state->actions));
    seeds.push_back(live::EncodeEvent(Decision{Signature("17"), kAbsent, stamp, number}));
  }
  return seeds;
}

void RunFuzzInput(std::string_view bytes) {
  const std::vector<std::string> frames = Frames(bytes, bytes.size() + 1);
  SHIFTMAP_CHECK(Frames(bytes, 3) == frames, "pieces make other messages");
  for (const std::string& frame : frames) DecodeAll(frame);
  DecodeAll(bytes);
}

}  // namespace shiftmap::testing
