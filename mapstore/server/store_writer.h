// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <future>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap::server {

/// The one writer of this process to a map store: a thread with a queue of bounded length. Reports
/// that wait are written together, in one transaction; each caller gets what became of its own. A
/// report waits for one note of an upload at most, however many are there.
///
/// Errors, of every write: as MapStore; kResourceExhausted if too many wait; kUnavailable once it
/// is stopped. Threads: any.
class StoreWriter {
 public:
  /// @param store     Open for writing.
  /// @param capacity  Of the queue.
  StoreWriter(MapStore store, std::size_t capacity);
  ~StoreWriter();
  StoreWriter(const StoreWriter&) = delete;
  StoreWriter& operator=(const StoreWriter&) = delete;

  /// As MapStore::Return: when it returns, the report is durable.
  StatusOr<ReturnResult> Return(ShiftReport report, std::string by);

  /// As MapStore::NoteUpload.
  Status NoteUpload(std::string log, std::string by);

  /// Writes what waits, and takes nothing more.
  void Stop();

  /// Writes that wait.
  std::size_t waiting() const;

  /// For how long the write that is under way has been; zero if none is.
  std::chrono::steady_clock::duration busy() const;

 private:
  // What is to be written: a report, or without one a note of an upload.
  struct Job {
    std::optional<ShiftReport> report;
    std::string log;
    std::string by;
    std::promise<StatusOr<ReturnResult>> done;
  };

  StatusOr<ReturnResult> Run(Job job);
  void Work();
  void WriteReports(std::vector<Job> jobs);

  MapStore store_;
  const std::size_t capacity_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Job> reports_;
  std::deque<Job> notes_;
  bool stopped_ = false;
  std::optional<std::chrono::steady_clock::time_point> busy_since_;
  std::thread thread_;
};

}  // namespace shiftmap::server
