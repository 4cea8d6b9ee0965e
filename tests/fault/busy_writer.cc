// SPDX-License-Identifier: Apache-2.0
//
// Commits versions to a map store and returns reports to it until it is killed; after each OK one
// line on stdout: "commit <version> <content hash>" or "return <uuid>".
//
//   shiftmap_busy_writer STORE WRITER PAUSE_MS
//     WRITER    a number that tells its reports from others'
//     PAUSE_MS  after each write; without a pause, others hardly ever find the file unlocked
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>

#include "mapstore/map_store.h"
#include "tests/fault/store_steps.h"

namespace shiftmap::testing {
namespace {

constexpr int kReportsPerVersion = 4;

// The line is written at once and whole: what was acknowledged, the reader of the pipe knows.
Status Acknowledge(const std::string& line) {
  const ssize_t written = write(STDOUT_FILENO, line.data(), line.size());
  if (written != static_cast<ssize_t>(line.size())) return Internal("cannot write to the pipe");
  return OkStatus();
}

// False if another writer published in between.
StatusOr<bool> CommitNext(MapStore& store, int writer, int round) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto areas, store.Areas());
  CommitOptions options;
  if (!areas.empty()) options.parent = areas.front().published;
  MapContent content = SmallMap(writer * 7 + round);
  content.stamp = SmallMap(0).stamp;
  const StatusOr<CommitResult> result = store.Commit("mine", content, {}, options);
  if (result.status().code() == StatusCode::kAborted) return false;
  SHIFTMAP_RETURN_IF_ERROR(result.status());
  SHIFTMAP_RETURN_IF_ERROR(
      Acknowledge(fmt::format("commit {} {}\n", result->version.value(), result->content_hash)));
  return true;
}

Status Write(const std::string& path, int writer, std::chrono::milliseconds pause) {
  MapStore::OpenOptions options;
  options.access = MapStore::Access::kReadWriteCreate;
  options.checkpoint_rows = 16;
  options.lock_timeout = std::chrono::seconds(60);
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, MapStore::Open(path, options));
  for (int round = 0;; ++round) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool committed, CommitNext(store, writer, round));
    std::this_thread::sleep_for(pause);
    if (!committed) continue;
    for (int i = 0; i < kReportsPerVersion; ++i) {
      SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, store.LoadAt("mine"));
      const int number = round * kReportsPerVersion + i;
      ShiftReport report = SmallReport(map, number);
      report.uuid = fmt::format("{:08x}-0000-4000-8000-{:012}", writer, number);
      SHIFTMAP_RETURN_IF_ERROR(store.Return(report).status());
      SHIFTMAP_RETURN_IF_ERROR(Acknowledge("return " + report.uuid + "\n"));
      std::this_thread::sleep_for(pause);
    }
  }
}

}  // namespace
}  // namespace shiftmap::testing

int main(int argc, char** argv) {
  if (argc != 4) return 2;
  const shiftmap::Status status = shiftmap::testing::Write(
      argv[1], std::atoi(argv[2]), std::chrono::milliseconds(std::atoi(argv[3])));
  std::fprintf(stderr, "busy writer: %s\n", status.ToString().c_str());
  return 1;
}
