// SPDX-License-Identifier: Apache-2.0
//
// A vehicle's service through a shift that the input has edited: it is killed and started again,
// its journal and saved pose are damaged or forged. It always starts, goes on answering, and the
// shift ends with a valid report.
#include "localizer/live/service.h"

#include <filesystem>
#include <memory>

#include "localizer/live/codec/journal_codec.h"
#include "localizer/live/codec/live_codec.h"
#include "localizer/live/saved_pose.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/map_store.h"
#include "proto/core/check.h"
#include "tests/fault/fault_plan.h"
#include "tests/fuzz/fuzz_run.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

enum Step : std::size_t { kFeed, kKill, kPose, kStop, kPatchJournal, kRecord, kSavedPose, kSteps };

class Vehicle {
 public:
  explicit Vehicle(const FuzzWorld& world) {
    static const TempDir folder;
    options_.map_path = folder.File("maps.db");
    options_.area = "area";
    options_.state_dir = folder.File("state");
    options_.vehicle = "truck";
    options_.software = "fuzz";
    options_.localizer.hypotheses.field_of_view.model = FieldOfViewModel::kScanPolygon;
    options_.clock = [] { return StampFromSeconds(4.0e9); };
    options_.warn = [](const std::string&) {};
    if (!std::filesystem::exists(options_.map_path)) {
      auto store = MapStore::Open(options_.map_path, MapStore::Access::kReadWriteCreate);
      SHIFTMAP_CHECK(store.ok(), "{}", Message(store.status()));
      const auto made = store->Commit("area", world.content, Provenance(), CommitOptions());
      SHIFTMAP_CHECK(made.ok(), "{}", Message(made.status()));
    }
    std::filesystem::remove_all(options_.state_dir);
  }

  void Open() {
    service_.reset();
    auto service = live::Service::Open(options_);
    SHIFTMAP_CHECK(service.ok(), "does not start: {}", Message(service.status()));
    service_ = std::make_unique<live::Service>(*std::move(service));
  }

  Status Do(const live::Command& command) {
    std::vector<live::Event> events;
    const live::Reply reply = service_->Handle({.id = 1, .command = command}, &events);
    for (const live::Event& event : events) {
      const auto decoded = live::DecodeEvent(live::EncodeEvent(event));
      SHIFTMAP_CHECK(decoded.ok(), "news: {}", Message(decoded.status()));
    }
    return reply.status;
  }

  // What a client would send; what the service's decoder refuses, never arrives.
  void Send(const live::Command& command) {
    std::uint64_t id = 0;
    const auto request = live::DecodeRequest(live::EncodeRequest({1, command}), &id);
    if (request.ok()) Do(request->command).IgnoreError();
  }

  void Feed(const RunEvent& event) {
    std::visit([&](const auto& item) { Send(item); }, event);
  }

  void Start() { Do(live::Start()).IgnoreError(); }

  void Stop() {
    service_->LocalizeHeld(std::chrono::steady_clock::time_point::max(), &ignored_);
    if (!service_->State().running) return;
    const Status stopped = Do(live::Stop{.save_pose = true});
    SHIFTMAP_CHECK(stopped.ok(), "the shift does not end: {}", Message(stopped));
    const auto report = ReadShiftReport(service_->State().report_path);
    SHIFTMAP_CHECK(report.ok(), "{}", Message(report.status()));
  }

  void Kill() {
    service_->WriteJournal();
    service_.reset();
  }

  std::string Journal() const { return options_.state_dir + "/shift.journal"; }
  std::string SavedPose() const { return options_.state_dir + "/pose"; }

 private:
  live::ServiceOptions options_;
  std::unique_ptr<live::Service> service_;
  std::vector<live::Event> ignored_;
};

void Patch(FuzzInput* input, const std::string& path) {
  if (!std::filesystem::exists(path)) return;
  std::string bytes = ReadFile(path);
  const std::size_t at = input->Take(2) % (bytes.size() + 1);
  const std::string_view patch = input->TakeBytes(input->Take(1) % 64);
  bytes.replace(at, std::min(patch.size(), bytes.size() - at), patch);
  WriteFile(path, bytes);
}

void AppendRecord(FuzzInput* input, const std::string& path) {
  if (!std::filesystem::exists(path)) return;
  auto end = live::ReadJournal(path, [](std::string_view) { return OkStatus(); });
  if (!end.ok()) return;
  auto journal = live::JournalFile::Resume(path, end->whole_bytes);
  if (!journal.ok()) return;
  if (input->Take(1) % 2 == 0) {
    journal->Append(live::EncodeJournalRecord(live::InitializePose{TakePose(input)}));
  } else {
    journal->Append(input->TakeBytes(input->Take(1)));
  }
  journal->Write().IgnoreError();
}

void SavePose(FuzzInput* input, const FuzzWorld& world, const std::string& path) {
  live::SavedPose saved;
  saved.area = "area";
  saved.content_hash = ContentHash(world.content);
  saved.stamp = input->Moved(StampFromSeconds(1000.0));
  saved.pose = TakePose(input);
  if (input->Take(1) % 2 == 1) saved.odometer_m = input->Number();
  live::WriteSavedPose(saved, path).IgnoreError();
}

// One step between two stretches of the run.
void Do(FuzzInput* input, const FuzzWorld& world, Vehicle* vehicle) {
  switch (input->Index(kSteps)) {
    case kPose:
      vehicle->Send(live::InitializePose{TakePose(input)});
      break;
    case kStop:
      vehicle->Stop();
      vehicle->Start();
      break;
    case kKill:
      vehicle->Kill();
      vehicle->Open();
      break;
    case kPatchJournal:
      vehicle->Kill();
      Patch(input, vehicle->Journal());
      vehicle->Open();
      break;
    case kRecord:
      vehicle->Kill();
      AppendRecord(input, vehicle->Journal());
      vehicle->Open();
      break;
    case kSavedPose:
      vehicle->Stop();
      SavePose(input, world, vehicle->SavedPose());
      vehicle->Start();
      break;
    default:
      break;
  }
}

}  // namespace

std::vector<std::string> FuzzSeeds() {
  using std::string_literals::operator""s;
  const std::string no_edit("\0\0\x06", 3);
  std::vector<std::string> seeds;
  for (const std::string& edit : EditSeeds()) {
    // Killed twice after the edit: the second start replays what the first did.
    seeds.push_back(edit + no_edit + "\x01\x01");
  }
  for (std::size_t i = 0; i < std::size(kExtremes); ++i) {
    const std::string number = ExtremeNumber(i);
    const std::string one = ExtremeNumber(2);
    for (const char step : {char{kPose}, char{kRecord}}) {
      const std::string head =
          no_edit + "\0\0"s + step + (step == kRecord ? std::string(1, '\0') : "");
      seeds.push_back(head + number + number + one + one + one + one + "\x01\x01");
      seeds.push_back(head + one + one + one + number + number + number + "\x01\x01");
    }
    seeds.push_back(no_edit + "\0\0"s + char{kSavedPose} + std::string(3, '\0') + number + number +
                    one + number + number + number);
  }
  seeds.push_back(no_edit + "\x04\0\x10\x08"s + std::string(8, '\xff'));
  return seeds;
}

void RunFuzzInput(std::string_view bytes) {
  constexpr std::size_t kStretches = 6;
  // Nothing fails, and nobody waits for the disk.
  FaultPlan none(Fault::kAnyOnce, 1'000'000'000);
  const ObservedFiles observed(none);
  static const FuzzWorld world;
  FuzzInput input(bytes);
  std::vector<RunEvent> events = world.events;
  EditEvents(&input, &events);
  Vehicle vehicle(world);
  vehicle.Open();
  vehicle.Start();
  std::size_t next = 0;
  for (std::size_t stretch = 1; stretch <= kStretches; ++stretch) {
    for (; next < stretch * events.size() / kStretches; ++next) vehicle.Feed(events[next]);
    if (!input.empty()) Do(&input, world, &vehicle);
  }
  vehicle.Stop();
  vehicle.Start();
  for (const RunEvent& event : world.events) vehicle.Feed(event);
  vehicle.Stop();
}

}  // namespace shiftmap::testing
