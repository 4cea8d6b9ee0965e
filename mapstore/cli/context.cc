// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/context.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <iostream>
#include <nlohmann/json.hpp>

#include "mapstore/core/inert_text.h"
#include "proto/core/check.h"

namespace shiftmap {

Context::Context(const CommonOptions& options, std::ostream* err, const TextStyle& style)
    : options_(options), err_(err), style_(style) {}

void Context::Report(const Json& document, const std::string& text) {
  SHIFTMAP_CHECK(!reported_, "a command reports once");
  reported_ = true;
  const auto columns = static_cast<std::size_t>(std::max(style_.columns, 0));
  output_ = json() ? JsonText(document) : RenderMarks(Wrapped(text, columns), style_.colour);
  summary_ = InertLine(RenderMarks(text.substr(0, text.find('\n')), /*colour=*/false));
}

void Context::Warn(const std::string& message) const {
  if (IsNew(message)) spdlog::warn("{}", InertLine(message));
}

void Context::SayEachOnce() {
  if (!said_) said_.emplace();
}

bool Context::IsNew(const std::string& message) const {
  return !said_ || said_->insert(message).second;
}

void Context::Attend(const std::string& message, ExitCode code) {
  done_code_ = code;
  const auto level = quiet() ? spdlog::level::err : spdlog::level::warn;
  if (IsNew(message)) spdlog::log(level, "{}", InertLine(message));
}

void Context::Inform(const std::string& message) const {
  if (IsNew(message)) spdlog::info("{}", InertLine(message));
}

std::unique_ptr<Progress> Context::MakeProgress() const {
  const bool visible = !quiet() && err_ == &std::cerr && StandardErrorIsTerminal();
  return std::make_unique<Progress>(visible ? err_ : nullptr);
}

std::string JsonText(const Json& document) {
  // Names come from logs and may be any bytes; a document is UTF-8.
  return InertText(document.dump(2, ' ', false, Json::error_handler_t::replace)) + '\n';
}

}  // namespace shiftmap
