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
    if (jobs_.size() >= capacity_) {
      return MakeStatus(StatusCode::kResourceExhausted, "{} writes wait already", jobs_.size());
    }
    jobs_.push_back(std::move(job));
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
  return jobs_.size();
}

std::chrono::steady_clock::duration StoreWriter::busy() const {
  const std::lock_guard lock(mutex_);
  if (!busy_since_) return {};
  return std::chrono::steady_clock::now() - *busy_since_;
}

void StoreWriter::Work() {
  for (;;) {
    std::vector<Job> jobs;
    {
      std::unique_lock lock(mutex_);
      busy_since_.reset();
      changed_.wait(lock, [this] { return stopped_ || !jobs_.empty(); });
      if (jobs_.empty()) return;
      const auto end =
          jobs_.begin() + static_cast<std::ptrdiff_t>(std::min(jobs_.size(), kMostTogether));
      jobs.assign(std::make_move_iterator(jobs_.begin()), std::make_move_iterator(end));
      jobs_.erase(jobs_.begin(), end);
      busy_since_ = std::chrono::steady_clock::now();
    }
    Write(std::move(jobs));
  }
}

void StoreWriter::Write(std::vector<Job> jobs) {
  std::vector<AttributedReport> reports;
  std::vector<Job*> reporters;
  for (Job& job : jobs) {
    if (job.report) {
      reports.push_back({*std::move(job.report), job.by});
      reporters.push_back(&job);
      continue;
    }
    const Status noted = store_.NoteUpload(job.log, job.by);
    job.done.set_value(noted.ok() ? StatusOr<ReturnResult>(ReturnResult()) : noted);
  }
  std::vector<StatusOr<ReturnResult>> results = store_.ReturnAll(reports);
  for (std::size_t i = 0; i < results.size(); ++i) {
    reporters[i]->done.set_value(std::move(results[i]));
  }
}

}  // namespace shiftmap::server
