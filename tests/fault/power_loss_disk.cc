// SPDX-License-Identifier: Apache-2.0
#include "tests/fault/power_loss_disk.h"

#include <algorithm>
#include <set>
#include <utility>

#include "proto/core/check.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

constexpr std::size_t kSector = 512;

bool Chance(std::mt19937_64& random, double probability) {
  return std::bernoulli_distribution(probability)(random);
}

// Extends content to a size; what was never written is zero, or whatever was on the disk before.
void Extend(std::size_t size, Leftover leftover, std::mt19937_64& random, std::string* content) {
  if (content->size() >= size) return;
  const bool garbage = leftover == Leftover::kSome && Chance(random, 0.5);
  const std::size_t old_size = content->size();
  content->resize(size, '\0');
  if (!garbage) return;
  for (std::size_t i = old_size; i < size; ++i) (*content)[i] = static_cast<char>(random());
}

}  // namespace

Verdict DiskRecorder::On(const FileEvent& event) {
  switch (event.operation) {
    case FileOperation::kRead:
    case FileOperation::kAccess:
    case FileOperation::kLock:
      return {};
    case FileOperation::kOpen:
      if (!event.creates) return {};
      break;
    default:
      break;
  }
  if (event.path.starts_with(folder_)) {
    changes_.push_back(
        {event.operation, event.path, event.target, event.offset, std::string(event.bytes)});
  }
  return {};
}

void PowerLossDisk::Rename(const NameChange& change, Names* names) {
  if (!change.source.empty()) names->erase(change.source);
  if (change.file) {
    (*names)[change.path] = *change.file;
  } else {
    names->erase(change.path);
  }
}

void PowerLossDisk::Change(NameChange change) {
  Rename(change, &names_);
  pending_names_.push_back(std::move(change));
}

void PowerLossDisk::Apply(const DiskChange& change) {
  if (change.operation == FileOperation::kOpen) {
    Change({.path = change.path, .file = files_.size(), .source = {}});
    files_.emplace_back();
    return;
  }
  if (change.operation == FileOperation::kSyncFolder) {
    // All files are in one folder.
    synced_names_ = names_;
    pending_names_.clear();
    return;
  }
  const auto found = names_.find(change.path);
  if (found == names_.end()) {
    SHIFTMAP_CHECK(change.operation == FileOperation::kDelete, "no file '{}'", change.path);
    return;
  }
  const FileNumber number = found->second;
  File& file = files_[number];
  const auto offset = static_cast<std::size_t>(change.offset);
  switch (change.operation) {
    case FileOperation::kWrite:
      file.pending.push_back({.truncates = false, .offset = offset, .bytes = change.bytes});
      return;
    case FileOperation::kTruncate:
      file.pending.push_back({.truncates = true, .offset = offset, .bytes = {}});
      return;
    case FileOperation::kSync: {
      std::mt19937_64 unused;
      file.synced = ContentOf(file, Leftover::kAll, unused);
      file.pending.clear();
      return;
    }
    case FileOperation::kDelete:
      Change({.path = change.path, .file = std::nullopt, .source = {}});
      return;
    case FileOperation::kRename:
      Change({.path = change.target, .file = number, .source = change.path});
      return;
    default:
      SHIFTMAP_CHECK(false, "operation {}", static_cast<int>(change.operation));
  }
}

std::string PowerLossDisk::ContentOf(const File& file, Leftover leftover, std::mt19937_64& random) {
  std::string content = file.synced;
  if (leftover == Leftover::kNone) return content;
  const double share = std::uniform_real_distribution<double>(0.0, 1.0)(random);
  for (const FileChange& change : file.pending) {
    const bool some = leftover == Leftover::kSome;
    if (change.truncates) {
      if (some && !Chance(random, share)) continue;
      Extend(change.offset, leftover, random, &content);
      content.resize(change.offset);
      continue;
    }
    // A write that is lost may have made the file longer all the same.
    const std::size_t end = change.offset + change.bytes.size();
    const bool torn = some && Chance(random, 0.25);
    const bool lost = some && !torn && !Chance(random, share);
    if (lost && Chance(random, 0.5)) continue;
    Extend(end, leftover, random, &content);
    if (lost) continue;
    for (std::size_t at = change.offset; at < end;) {
      const std::size_t next = std::min(end, (at / kSector + 1) * kSector);
      if (!torn || Chance(random, 0.5)) {
        content.replace(at, next - at, change.bytes, at - change.offset, next - at);
      }
      at = next;
    }
  }
  return content;
}

PowerLossDisk::Names PowerLossDisk::NamesLeft(Leftover leftover, std::mt19937_64& random) const {
  if (leftover == Leftover::kNone) return synced_names_;
  if (leftover == Leftover::kAll) return names_;
  Names names = synced_names_;
  // The changes of one name keep their order: once one is lost, so are those after it.
  std::set<std::string> lost;
  for (const NameChange& change : pending_names_) {
    if (lost.contains(change.path) || lost.contains(change.source) || Chance(random, 0.5)) {
      lost.insert(change.path);
      if (!change.source.empty()) lost.insert(change.source);
      continue;
    }
    Rename(change, &names);
  }
  return names;
}

void PowerLossDisk::WriteImage(Leftover leftover,
                               std::mt19937_64& random,
                               const std::string& folder) const {
  for (const auto& [path, number] : NamesLeft(leftover, random)) {
    const std::string name = path.substr(path.rfind('/'));
    WriteFile(folder + name, ContentOf(files_[number], leftover, random));
  }
}

}  // namespace shiftmap::testing
