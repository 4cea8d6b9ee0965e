// SPDX-License-Identifier: Apache-2.0
//
// Reads hostile bags. The first byte of the input says what the rest is: a definition and a message
// of it; messages of a bag in MCAP, whose checksums are right; patches of the bytes of a SQLite
// file; or the text of the metadata. Whatever is read without an error must be a run in order.
#include <filesystem>

#include "proto/core/check.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/tools/convert/rosbag2/bag_test_util.h"
#include "tools/convert/rosbag2/builtin_definitions.h"
#include "tools/convert/rosbag2/cdr.h"
#include "tools/convert/rosbag2/rosbag2.h"

namespace shiftmap::testing {
namespace {

namespace bag = rosbag2::testing;

constexpr char kNext = '\xff';

void Read(const std::string& path) {
  rosbag2::Rosbag2Options options;
  options.path = path;
  const auto read = rosbag2::ReadRosbag2(options);
  if (!read.ok()) {
    SHIFTMAP_CHECK(read.status().code() != StatusCode::kInternal, "{}", Message(read.status()));
    return;
  }
  const Status valid = ValidateRun(read->run);
  SHIFTMAP_CHECK(valid.ok(), "an invalid run was read: {}", Message(valid));
}

void ReadDefinition(std::string_view bytes) {
  const std::size_t end = std::min(bytes.find(kNext), bytes.size());
  const auto definition = rosbag2::MessageDefinition::Parse("p/A", bytes.substr(0, end));
  if (!definition.ok()) return;
  bytes.remove_prefix(std::min(end + 1, bytes.size()));
  rosbag2::DecodeCdr(*definition, bytes).status().IgnoreError();
}

void ReadMessages(FuzzInput input, const std::string& folder) {
  std::vector<bag::Message> messages = bag::SmallDrive();
  while (!input.empty()) {
    bag::Message& message = messages[input.Index(messages.size())];
    const std::size_t at = input.Index(message.data.size() + 1);
    const std::string_view patch = input.TakeBytes(input.Take(1) % 32);
    message.data.replace(at, std::min(patch.size(), message.data.size() - at), patch);
  }
  const std::string path = folder + "/bag.mcap";
  bag::WriteMcapBag(path, messages);
  Read(path);
}

void ReadSqlite(FuzzInput input, const std::string& folder) {
  static const std::string whole = [&] {
    const std::string path = folder + "/whole.db3";
    bag::WriteSqliteBag(path, bag::SmallDrive());
    return ReadFile(path);
  }();
  std::string bytes = whole;
  while (!input.empty()) {
    const std::size_t at = input.Take(2) % bytes.size();
    const std::string_view patch = input.TakeBytes(1 + input.Take(1) % 16);
    bytes.replace(at, std::min(patch.size(), bytes.size() - at), patch);
  }
  const std::string path = folder + "/bag.db3";
  WriteFile(path, bytes);
  Read(path);
}

void ReadMetadata(std::string_view bytes, const std::string& folder) {
  const std::string path = folder + "/bag";
  std::filesystem::create_directory(path);
  WriteFile(path + "/metadata.yaml", std::string(bytes));
  Read(path);
}

}  // namespace

std::vector<std::string> FuzzSeeds() {
  using namespace std::string_literals;
  std::vector<std::string> seeds = {
      "",
      "\0float64 a\nB[2] b\nstring[] c\n===\nMSG: p/B\nint8[<=3] d\nuint16 E=3\n\xff\0\1\0\0"s +
          std::string(60, '\0'),
      "\0A[] a\n"s,
      "\3rosbag2_bagfile_information:\n  relative_file_paths:\n    - bag_0.mcap\n",
      "\3rosbag2_bagfile_information: &a [*a, {b: !!binary c}]\n",
  };
  for (const char* type : {"vision_msgs/Detection3DArray", "tf2_msgs/TFMessage"}) {
    seeds.push_back("\0"s + rosbag2::BuiltinDefinition(type) + kNext +
                    bag::Detections(5, {{"L1", {}, 1.0}}));
  }
  for (std::size_t i = 0; i < 40; ++i) {
    const auto byte = [](std::size_t value) { return static_cast<char>(value % 251); };
    // A number of a message, somewhere, becomes an extreme one; or a count a large one.
    seeds.push_back("\1"s + byte(7 * i) + byte(37 * i) + "\10" + ExtremeNumber(i % 30));
    seeds.push_back("\1"s + byte(7 * i) + byte(4 * i) + "\4\xff\xff\xff\x7f");
    seeds.push_back("\2"s + byte(3 * i) + byte(61 * i) + "\7" + std::string(8, byte(i * 97)));
  }
  return seeds;
}

void RunFuzzInput(std::string_view bytes) {
  static const TempDir folder;
  if (bytes.empty()) return;
  const std::string_view rest = bytes.substr(1);
  switch (bytes.front() % 4) {
    case 0:
      return ReadDefinition(rest);
    case 1:
      return ReadMessages(FuzzInput(rest), folder.path());
    case 2:
      return ReadSqlite(FuzzInput(rest), folder.path());
    default:
      return ReadMetadata(rest, folder.path());
  }
}

}  // namespace shiftmap::testing
