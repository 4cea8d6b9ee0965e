// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/store_writer.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace shiftmap::server {
namespace {

// Reports that share a transaction: more would let the first ones wait for the last.
constexpr std::size_t kMostTogether = 64;

}  // namespace

StoreWriter::StoreWriter(MapStore store, std::size_t capacity)
    : store_(std::move(store)), capacity_(capacity), thread_([this] { Work(); }) {}

StoreWriter::~StoreWriter() { Stop(); }

StatusOr<ReturnResult> StoreWriter::Return(ShiftReport report, std::string by) {
  return Run({std::move(report), "", std::move(by), {}});
}

Status StoreWriter::NoteUpload(std::string log, std::string by) {
  return Run({std::nullopt, std::move(log), std::move(by), {}}).status();
}

StatusOr<ReturnResult> StoreWriter::Run(Job job) {
  std::future<StatusOr<ReturnResult>> done = job.done.get_future();
  {
    const std::lock_guard lock(mutex_);
    if (stopped_) return Unavailable("the server is stopping");
    const std::size_t waiting = reports_.size() + notes_.size();
    if (waiting >= capacity_) {
      return MakeStatus(StatusCode::kResourceExhausted, "{} writes wait already", waiting);
    }
    (job.report ? reports_ : notes_).push_back(std::move(job));
  }
  changed_.notify_one();
  return done.get();
}

void StoreWriter::Stop() {
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  changed_.notify_one();
  if (thread_.joinable()) thread_.join();
}

std::size_t StoreWriter::waiting() const {
  const std::lock_guard lock(mutex_);
  return reports_.size() + notes_.size();
}

std::chrono::steady_clock::duration StoreWriter::busy() const {
  const std::lock_guard lock(mutex_);
  if (!busy_since_) return {};
  return std::chrono::steady_clock::now() - *busy_since_;
}

void StoreWriter::Work() {
  for (;;) {
    std::vector<Job> reports;
    std::optional<Job> note;
    {
      std::unique_lock lock(mutex_);
      busy_since_.reset();
      changed_.wait(lock, [this] { return stopped_ || !reports_.empty() || !notes_.empty(); });
      if (reports_.empty() && notes_.empty()) return;
      const auto end =
          reports_.begin() + static_cast<std::ptrdiff_t>(std::min(reports_.size(), kMostTogether));
      reports.assign(std::make_move_iterator(reports_.begin()), std::make_move_iterator(end));
      reports_.erase(reports_.begin(), end);
      if (!notes_.empty()) {
        note = std::move(notes_.front());
        notes_.pop_front();
      }
      busy_since_ = std::chrono::steady_clock::now();
    }
    WriteReports(std::move(reports));
    if (!note) continue;
    const Status noted = store_.NoteUpload(note->log, note->by);
    note->done.set_value(noted.ok() ? StatusOr<ReturnResult>(ReturnResult()) : noted);
  }
}

void StoreWriter::WriteReports(std::vector<Job> jobs) {
  if (jobs.empty()) return;
  std::vector<AttributedReport> reports;
  for (Job& job : jobs) reports.push_back({*std::move(job.report), job.by});
  std::vector<StatusOr<ReturnResult>> results = store_.ReturnAll(reports);
  for (std::size_t i = 0; i < results.size(); ++i) {
    jobs[i].done.set_value(std::move(results[i]));
  }
}

}  // namespace shiftmap::server
