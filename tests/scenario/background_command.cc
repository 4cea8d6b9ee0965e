// SPDX-License-Identifier: Apache-2.0
#include "tests/scenario/background_command.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <thread>

#include "proto/core/check.h"

namespace shiftmap::testing {
namespace {

constexpr int kExecFailed = 127;

std::vector<char*> Pointers(std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  for (std::string& text : texts) pointers.push_back(text.data());
  pointers.push_back(nullptr);
  return pointers;
}

}  // namespace

BackgroundCommand::BackgroundCommand(const std::string& program,
                                     const Arguments& arguments,
                                     const std::vector<std::string>& environment,
                                     const std::string& input) {
  const std::string out = folder_.File("out");
  const std::string err = folder_.File("err");
  std::vector<std::string> words = arguments;
  words.insert(words.begin(), std::string(SHIFTMAP_BINARY_DIR) + "/" + program);
  std::vector<std::string> variables = environment;
  for (char** entry = environ; *entry != nullptr; ++entry) variables.emplace_back(*entry);
  const std::vector<char*> argv = Pointers(words);
  const std::vector<char*> envp = Pointers(variables);
  WriteFile(err, "");
  child_ = fork();
  SHIFTMAP_CHECK(child_ >= 0, "fork for {}", program);
  if (child_ != 0) return;
  const int out_fd = open(out.c_str(), O_WRONLY | O_CREAT, 0600);
  const int err_fd = open(err.c_str(), O_WRONLY | O_APPEND);
  const int in_fd = input.empty() ? STDIN_FILENO : open(input.c_str(), O_RDONLY);
  if (dup2(in_fd, STDIN_FILENO) < 0 || dup2(out_fd, STDOUT_FILENO) < 0 ||
      dup2(err_fd, STDERR_FILENO) < 0) {
    _exit(kExecFailed);
  }
  execve(argv[0], argv.data(), envp.data());
  _exit(kExecFailed);
}

BackgroundCommand::~BackgroundCommand() {
  if (child_ > 0) End(SIGKILL);
}

int BackgroundCommand::End(int signal) {
  kill(child_, signal);
  int status = 0;
  rusage usage{};
  SHIFTMAP_CHECK(wait4(child_, &status, 0, &usage) == child_, "wait for {}", child_);
  child_ = -1;
  peak_mib_ = static_cast<double>(usage.ru_maxrss) / 1024.0;
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

void BackgroundCommand::WaitUntilItCatches(int signal) const {
  const std::string path = fmt::format("/proc/{}/status", child_);
  const std::string key = "SigCgt:\t";
  for (int tries = 0; tries < 10000 * kSlowdown; ++tries) {
    const std::string status = ReadFile(path);
    const std::size_t at = status.find(key);
    if (at != std::string::npos) {
      const std::uint64_t caught = std::stoull(status.substr(at + key.size(), 16), nullptr, 16);
      if ((caught >> (signal - 1) & 1) != 0) return;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  SHIFTMAP_CHECK(false, "process {} does not catch signal {}", child_, signal);
}

}  // namespace shiftmap::testing
