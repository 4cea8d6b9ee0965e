// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/memory_bound.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <filesystem>

#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

constexpr std::int64_t kMib = std::int64_t{1} << 20;

class MemoryBoundTest : public ::testing::Test {
 protected:
  // A limit of a group, as the kernel shows it.
  void Limit(const std::string& path, const std::string& text) {
    const std::filesystem::path file = sources_.cgroup_root + path;
    std::filesystem::create_directories(file.parent_path());
    testing::WriteFile(file, text + "\n");
  }
  void Groups(const std::string& text) { testing::WriteFile(sources_.process_cgroup, text); }

  testing::TempDir folder_;
  MemoryBoundSources sources_{folder_.File("cgroup"), folder_.File("fs")};
};

TEST_F(MemoryBoundTest, WithoutAGroupItIsTheMachine) {
  const std::int64_t machine = MemoryBound(sources_);
  EXPECT_GT(machine, 64 * kMib);
  Groups("0::/\n");
  EXPECT_EQ(MemoryBound(sources_), machine);
  Limit("/memory.max", "max");
  EXPECT_EQ(MemoryBound(sources_), machine);
  Limit("/memory.max", "9223372036854771712");
  EXPECT_EQ(MemoryBound(sources_), machine);
}

TEST_F(MemoryBoundTest, TheLeastOfTheGroupsAboveHolds) {
  Groups("0::/site/nightly.service\n");
  Limit("/site/nightly.service/memory.max", std::to_string(30 * kMib));
  EXPECT_EQ(MemoryBound(sources_), 30 * kMib);
  Limit("/site/memory.max", std::to_string(20 * kMib));
  EXPECT_EQ(MemoryBound(sources_), 20 * kMib);
  Limit("/memory.max", std::to_string(10 * kMib));
  EXPECT_EQ(MemoryBound(sources_), 10 * kMib);
}

// A container sees its own group at the root, and the host's path.
TEST_F(MemoryBoundTest, VersionOneHasAFolderPerController) {
  Groups("12:cpu,cpuacct:/a\n9:hugetlb,memory:/docker/0123\n1:name=systemd:/b\n0::/\n");
  Limit("/memory/memory.limit_in_bytes", std::to_string(15 * kMib));
  Limit("/cpu/a/memory.limit_in_bytes", std::to_string(kMib));
  EXPECT_EQ(MemoryBound(sources_), 15 * kMib);
}

TEST_F(MemoryBoundTest, LimitsOfTheProcessCount) {
  Groups("garbage\n::\n0::no/slash\n");
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_DATA, &before), 0);
  rlimit lower = before;
  lower.rlim_cur = 4096 * kMib;
  const std::int64_t machine = MemoryBound(sources_);
  ASSERT_EQ(setrlimit(RLIMIT_DATA, &lower), 0);
  EXPECT_EQ(MemoryBound(sources_), std::min(machine, 4096 * kMib));
  lower.rlim_cur = 1024 * kMib;
  ASSERT_EQ(setrlimit(RLIMIT_DATA, &lower), 0);
  EXPECT_EQ(MemoryBound(sources_), std::min(machine, 1024 * kMib));
  ASSERT_EQ(setrlimit(RLIMIT_DATA, &before), 0);
}

}  // namespace
}  // namespace shiftmap
