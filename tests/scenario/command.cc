// SPDX-License-Identifier: Apache-2.0
#include "tests/scenario/command.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "proto/core/check.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

constexpr int kExecFailed = 127;
constexpr uid_t kNobody = 65534;

std::vector<char*> Pointers(std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  for (std::string& text : texts) pointers.push_back(text.data());
  pointers.push_back(nullptr);
  return pointers;
}

std::vector<std::string> Environment(const std::vector<std::string>& added) {
  std::vector<std::string> all = added;
  for (char** entry = environ; *entry != nullptr; ++entry) all.emplace_back(*entry);
  return all;
}

// Puts a file or a pipe's end in the place of a standard stream, in the child.
void Redirect(int fd, int stream) {
  if (fd < 0 || dup2(fd, stream) < 0) _exit(kExecFailed);
}

void WriteAll(int fd, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = write(fd, bytes.data(), bytes.size());
    if (written <= 0) return;  // The command does not want to read all of it.
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

std::string Shown(const std::string& program, const Arguments& arguments) {
  std::string text = program;
  for (const std::string& argument : arguments) text += " " + argument;
  return text;
}

// A build takes the solver that SHIFTMAP_TEST_SOLVER names, so that every scenario can be run with
// either.
void AddSolver(const std::string& program, std::vector<std::string>* words) {
  const char* solver = std::getenv("SHIFTMAP_TEST_SOLVER");
  if (solver == nullptr || program != "shiftmap-mapper") return;
  if (words->empty() || words->front() != "build") return;
  for (const char* option : {"--solver", "--engine"}) {
    if (std::find(words->begin(), words->end(), option) != words->end()) return;
  }
  words->insert(words->end(), {"--solver", solver});
}

// True for one whole JSON document and nothing else.
bool IsDocument(const std::string& text) { return Json::accept(text) && text.ends_with('\n'); }

}  // namespace

CommandResult RunCommand(const std::string& program,
                         const Arguments& arguments,
                         const CommandOptions& options) {
  const TempDir folder;
  const std::string out = options.output.empty() ? folder.File("out") : options.output;
  const std::string err = folder.File("err");
  std::vector<std::string> words = arguments;
  AddSolver(program, &words);
  words.insert(words.begin(), std::string(SHIFTMAP_BINARY_DIR) + "/" + program);
  std::vector<std::string> environment = Environment(options.environment);
  const std::vector<char*> argv = Pointers(words);
  const std::vector<char*> envp = Pointers(environment);

  int input[2];
  SHIFTMAP_CHECK(pipe2(input, O_CLOEXEC) == 0, "pipe for {}", program);
  const pid_t child = fork();
  SHIFTMAP_CHECK(child >= 0, "fork for {}", program);
  if (child == 0) {
    Redirect(input[0], STDIN_FILENO);
    Redirect(open(out.c_str(), O_WRONLY | O_CREAT, 0600), STDOUT_FILENO);
    Redirect(open(err.c_str(), O_WRONLY | O_CREAT, 0600), STDERR_FILENO);
    if (options.unprivileged && geteuid() == 0 && setuid(kNobody) != 0) _exit(kExecFailed);
    execve(argv[0], argv.data(), envp.data());
    _exit(kExecFailed);
  }
  close(input[0]);
  const auto previous = std::signal(SIGPIPE, SIG_IGN);
  WriteAll(input[1], options.input);
  close(input[1]);
  std::signal(SIGPIPE, previous);
  int status = 0;
  SHIFTMAP_CHECK(waitpid(child, &status, 0) == child, "wait for {}", program);

  CommandResult result;
  result.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  if (options.output.empty()) result.out = ReadFile(out);
  result.err = ReadFile(err);
  return result;
}

Json RunForJson(const std::string& program,
                const Arguments& arguments,
                const CommandOptions& options) {
  SCOPED_TRACE(Shown(program, arguments));
  Arguments with_json = arguments;
  with_json.emplace_back("--json");
  const CommandResult result = RunCommand(program, with_json, options);
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_TRUE(IsDocument(result.out)) << result.out;
  return Json::parse(result.out, nullptr, /*allow_exceptions=*/false);
}

void ExpectError(const std::string& program,
                 const Arguments& arguments,
                 int exit_code,
                 const std::string& object,
                 const CommandOptions& options) {
  SCOPED_TRACE(Shown(program, arguments));
  for (const bool json : {false, true}) {
    Arguments words = arguments;
    if (json) words.emplace_back("--json");
    const CommandResult result = RunCommand(program, words, options);
    EXPECT_EQ(result.exit_code, exit_code) << result.err;
    EXPECT_EQ(CountLines(result.err), 1) << result.err;
    EXPECT_TRUE(result.err.starts_with(program + ": ")) << result.err;
    EXPECT_NE(result.err.find(object), std::string::npos) << result.err << "lacks " << object;
    if (!json) {
      EXPECT_EQ(result.out, "");
      continue;
    }
    ASSERT_TRUE(IsDocument(result.out)) << result.out;
    const Json document = Json::parse(result.out);
    EXPECT_EQ(document.value("exit_code", -1), exit_code) << result.out;
    EXPECT_NE(document.value("error", "").find(object), std::string::npos) << result.out;
  }
}

int CountLines(const std::string& text) {
  const auto ends = std::count(text.begin(), text.end(), '\n');
  const bool open_end = !text.empty() && text.back() != '\n';
  return static_cast<int>(ends) + (open_end ? 1 : 0);
}

}  // namespace shiftmap::testing
