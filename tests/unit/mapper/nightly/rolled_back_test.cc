// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/rolled_back.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace shiftmap {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// Versions 1 <- 2 <- 3 <- 4, and 5 of 2.
std::vector<VersionSummary> Versions() {
  std::vector<VersionSummary> versions(5);
  const std::vector<int> parents = {0, 1, 2, 3, 2};
  for (int i = 0; i < 5; ++i) {
    VersionSummary& version = versions[static_cast<std::size_t>(i)];
    version.version = VersionNumber(i + 1);
    const int parent = parents[static_cast<std::size_t>(i)];
    if (parent > 0) version.parent = VersionNumber(parent);
  }
  return versions;
}

// An audit log of "publish 1", "rollback 1" and others.
std::vector<AuditEntry> Audit(const std::vector<std::string>& lines) {
  std::vector<AuditEntry> audit;
  for (const std::string& line : lines) {
    const std::size_t blank = line.find(' ');
    audit.push_back({{}, "floor", line.substr(0, blank), line.substr(blank + 1)});
  }
  return audit;
}

std::vector<std::int64_t> RolledBack(const std::vector<std::string>& lines) {
  std::vector<std::int64_t> numbers;
  for (const VersionNumber version : RolledBackVersions(Versions(), Audit(lines))) {
    numbers.push_back(version.value());
  }
  return numbers;
}

TEST(RolledBackVersions, AreAllThatARollbackWentPast) {
  EXPECT_THAT(RolledBack({"publish 1", "publish 2", "commit 3", "publish 3", "publish 4"}),
              IsEmpty());
  EXPECT_THAT(RolledBack({"publish 1", "publish 2", "publish 3", "publish 4", "rollback 2"}),
              ElementsAre(3, 4));
}

TEST(RolledBackVersions, StayWhenAnotherOneIsPublished) {
  EXPECT_THAT(RolledBack({"publish 1", "publish 2", "publish 3", "rollback 2", "publish 5"}),
              ElementsAre(3));
}

TEST(RolledBackVersions, AreNoneOnceTheyOrADescendantArePublishedAgain) {
  EXPECT_THAT(RolledBack({"publish 2", "publish 3", "rollback 2", "publish 3"}), IsEmpty());
  EXPECT_THAT(RolledBack({"publish 3", "rollback 2", "rollback 1", "publish 4"}), IsEmpty());
  EXPECT_THAT(RolledBack({"publish 3", "rollback 2", "rollback 1", "publish 2"}), ElementsAre(3));
}

TEST(RolledBackVersions, LeaveVersionsThatWereNeverPublished) {
  EXPECT_THAT(RolledBack({"publish 2", "commit 3", "refuse 3 it is worse", "rollback 1"}),
              ElementsAre(2));
}

}  // namespace
}  // namespace shiftmap
