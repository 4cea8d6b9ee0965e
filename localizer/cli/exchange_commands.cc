// SPDX-License-Identifier: Apache-2.0
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>

#include "localizer/cli/commands.h"
#include "localizer/cli/return_to_store.h"

namespace shiftmap {
namespace {

// Returns only if it fails.
Status HandOver(std::vector<std::string> arguments) {
  std::error_code error;
  const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", error);
  const std::string program = (self.parent_path() / "shiftmap-transfer").string();
  std::string name = "shiftmap-localizer";  // Messages begin with it.
  std::vector<char*> words = {name.data()};
  for (std::string& argument : arguments) words.push_back(argument.data());
  words.push_back(nullptr);
  execv(program.c_str(), words.data());
  return MakeStatus(errno == ENOENT ? StatusCode::kNotFound : StatusCode::kUnavailable,
                    "program '{}': cannot be started: {}",
                    program,
                    std::strerror(errno));
}

}  // namespace

void AddExchangeCommands(Application* application, const std::vector<std::string>& arguments) {
  const auto hand_over = [arguments](const auto&, Context&) { return HandOver(arguments); };
  AddReturnCommand(application, [arguments](const ReturnArguments& options, Context& context) {
    return options.store.empty() ? HandOver(arguments) : ReturnToStore(options, context);
  });
  AddFetchCommand(application, hand_over);
  AddUploadCommand(application, hand_over);
  AddSyncCommand(application, hand_over);
}

}  // namespace shiftmap
