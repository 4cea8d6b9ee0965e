// SPDX-License-Identifier: Apache-2.0
#include "tests/scenario/background_command.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>

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
                                     const std::vector<std::string>& environment) {
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
  if (dup2(out_fd, STDOUT_FILENO) < 0 || dup2(err_fd, STDERR_FILENO) < 0) _exit(kExecFailed);
  execve(argv[0], argv.data(), envp.data());
  _exit(kExecFailed);
}

BackgroundCommand::~BackgroundCommand() {
  if (child_ > 0) End(SIGKILL);
}

int BackgroundCommand::End(int signal) {
  kill(child_, signal);
  int status = 0;
  SHIFTMAP_CHECK(waitpid(child_, &status, 0) == child_, "wait for {}", child_);
  child_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

}  // namespace shiftmap::testing
