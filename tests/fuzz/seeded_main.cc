// SPDX-License-Identifier: Apache-2.0
//
// Runs a target with any compiler, the same inputs every time: its seeds, then mutations of them.
// Usage: TARGET [-runs=N] [-seed=N] [FILE...]; with files, these alone.
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "tests/fuzz/fuzz_input.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

constexpr unsigned kMaxSecondsPerInput = 20;
constexpr std::size_t kMaxBytes = 4096;

class Mutator {
 public:
  Mutator(std::vector<std::string> seeds, std::uint64_t seed)
      : seeds_(std::move(seeds)), random_(seed) {
    if (seeds_.empty()) seeds_.emplace_back();
  }

  std::string Next() {
    std::string bytes = seeds_[Below(seeds_.size())];
    for (std::size_t edits = 1 + Below(4); edits > 0; --edits) Edit(&bytes);
    if (bytes.size() > kMaxBytes) bytes.resize(kMaxBytes);
    return bytes;
  }

 private:
  std::size_t Below(std::size_t count) { return static_cast<std::size_t>(random_() % count); }
  char Byte() { return static_cast<char>(Below(256)); }

  void Edit(std::string* bytes) {
    const std::size_t at = Below(bytes->size() + 1);
    const std::size_t length = 1 + Below(8);
    switch (Below(6)) {
      case 0:
        if (at < bytes->size()) (*bytes)[at] = Byte();
        break;
      case 1:
        for (std::size_t i = 0; i < length; ++i) bytes->insert(at, 1, Byte());
        break;
      case 2:
        bytes->erase(at, length);
        break;
      case 3:
        bytes->insert(at, bytes->substr(Below(bytes->size() + 1), 8 * length));
        break;
      case 4:
        if (at < bytes->size()) (*bytes)[at] = static_cast<char>((*bytes)[at] ^ (1 << Below(8)));
        break;
      default: {
        const std::string& other = seeds_[Below(seeds_.size())];
        bytes->replace(at, std::string::npos, other.substr(Below(other.size() + 1)));
      }
    }
  }

  std::vector<std::string> seeds_;
  std::mt19937_64 random_;
};

// What the last input was, for the one who looks at the crash.
void Run(const std::string& bytes, const std::string& keep_as) {
  WriteFile(keep_as, bytes);
  alarm(kMaxSecondsPerInput);
  RunFuzzInput(bytes);
}

int Main(int argc, char** argv) {
  std::uint64_t runs = 1000;
  std::uint64_t seed = 1;
  std::vector<std::string> files;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument.starts_with("-runs=")) {
      runs = std::stoull(argument.substr(6));
    } else if (argument.starts_with("-seed=")) {
      seed = std::stoull(argument.substr(6));
    } else {
      files.push_back(argument);
    }
  }
  for (const std::string& file : files) RunFuzzInput(ReadFile(file));
  if (!files.empty()) return 0;
  const std::string last = std::string(argv[0]) + ".last-input";
  const std::vector<std::string> seeds = FuzzSeeds();
  for (const std::string& bytes : seeds) Run(bytes, last);
  Mutator mutator(seeds, seed);
  for (std::uint64_t i = seeds.size(); i < runs; ++i) Run(mutator.Next(), last);
  std::remove(last.c_str());
  std::printf("%zu seeds, %llu runs\n", seeds.size(), static_cast<unsigned long long>(runs));
  return 0;
}

}  // namespace
}  // namespace shiftmap::testing

int main(int argc, char** argv) { return shiftmap::testing::Main(argc, argv); }
