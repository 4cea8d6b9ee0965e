// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/action_log.h"

#include <algorithm>
#include <chrono>

#include "localizer/live/checked_file.h"
#include "localizer/live/codec/journal_codec.h"

namespace shiftmap::live {
namespace {

constexpr std::string_view kKind = "actions";

}  // namespace

Status ActionLog::Read() {
  const auto message = ReadCheckedFile(kKind, path_);
  if (message.status().code() == StatusCode::kNotFound) return OkStatus();
  auto actions = message.ok() ? DecodeActionStates(*message) : message.status();
  if (!actions.ok()) {
    return DataLoss("actions '{}': {}, forgotten", path_, Message(actions.status()));
  }
  actions_ = *std::move(actions);
  for (const ActionState& action : std::vector<ActionState>(actions_)) {
    if (!action.ended()) {
      Set(action.action_id, ActionStatus::kFailed, "interrupted: the localizer was restarted");
    }
  }
  return OkStatus();
}

const ActionState* ActionLog::Find(const std::string& action_id) const {
  for (const ActionState& action : actions_) {
    if (action.action_id == action_id) return &action;
  }
  return nullptr;
}

Status ActionLog::Add(const ActionState& action) {
  if (actions_.size() >= kMaxActions) {
    const auto oldest = std::find_if(
        actions_.begin(), actions_.end(), [](const ActionState& old) { return old.ended(); });
    if (oldest == actions_.end()) {
      return MakeStatus(StatusCode::kResourceExhausted,
                        "{} actions are under way, expected fewer",
                        actions_.size());
    }
    actions_.erase(oldest);
    overflowed_ = true;
  }
  actions_.push_back(action);
  changed_ = true;
  return OkStatus();
}

void ActionLog::Set(const std::string& action_id, ActionStatus status, std::string result) {
  if (result.size() > kMaxResultBytes) result.resize(kMaxResultBytes);
  for (ActionState& action : actions_) {
    if (action.action_id != action_id) continue;
    action.status = status;
    action.result = std::move(result);
    changed_ = true;
    return;
  }
}

void ActionLog::Clear() {
  std::erase_if(actions_, [](const ActionState& action) { return action.ended(); });
  changed_ = true;
  overflowed_ = false;
}

Status ActionLog::Write() const {
  return WriteCheckedFile(kKind, EncodeActionStates(actions_), path_);
}

Status ActionLog::StartWrite() {
  Status status = OkStatus();
  if (writing_.valid()) {
    if (writing_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return status;
    status = writing_.get();
  }
  if (!std::exchange(changed_, false)) return status;
  std::string message = EncodeActionStates(actions_);
  writing_ = std::async(std::launch::async, [path = path_, message = std::move(message)] {
    return WriteCheckedFile(kKind, message, path);
  });
  return status;
}

Status ActionLog::Finish() {
  if (writing_.valid()) writing_.wait();
  SHIFTMAP_RETURN_IF_ERROR(writing_.valid() ? writing_.get() : OkStatus());
  return std::exchange(changed_, false) ? Write() : OkStatus();
}

}  // namespace shiftmap::live
