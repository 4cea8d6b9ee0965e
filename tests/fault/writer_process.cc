// SPDX-License-Identifier: Apache-2.0
#include "tests/fault/writer_process.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>
#include <csignal>

#include <utility>

#include "proto/core/check.h"

namespace shiftmap::testing {

WriterProcess::WriterProcess(const std::string& store, int writer, int pause_ms) {
  int ends[2];
  SHIFTMAP_CHECK(pipe2(ends, O_CLOEXEC) == 0, "pipe");
  // Far more than a writer acknowledges between two kills: it never waits for the reader.
  fcntl(ends[0], F_SETPIPE_SZ, 1 << 20);
  const std::string number = std::to_string(writer);
  const std::string pause = std::to_string(pause_ms);
  pid_ = fork();
  SHIFTMAP_CHECK(pid_ >= 0, "fork");
  if (pid_ == 0) {
    dup2(ends[1], STDOUT_FILENO);
    execl(SHIFTMAP_BUSY_WRITER,
          SHIFTMAP_BUSY_WRITER,
          store.c_str(),
          number.c_str(),
          pause.c_str(),
          nullptr);
    _exit(127);
  }
  close(ends[1]);
  pipe_ = ends[0];
}

WriterProcess::~WriterProcess() {
  std::vector<std::string> unread;
  if (pid_ > 0) Kill(&unread);
}

bool WriterProcess::Kill(std::vector<std::string>* lines) {
  kill(pid_, SIGKILL);
  int status = 0;
  SHIFTMAP_CHECK(waitpid(pid_, &status, 0) == pid_, "waitpid");
  pid_ = -1;
  std::string line;
  char bytes[4096];
  for (;;) {
    const ssize_t count = read(pipe_, bytes, sizeof bytes);
    if (count <= 0) break;
    for (const char c : std::string(bytes, static_cast<std::size_t>(count))) {
      if (c == '\n') {
        lines->push_back(std::exchange(line, {}));
      } else {
        line += c;
      }
    }
  }
  close(pipe_);
  return WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL;
}

}  // namespace shiftmap::testing
