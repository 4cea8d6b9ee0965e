// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/sha256.h"

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

// FIPS 180-2, appendix B.1.
constexpr char kAbc[] = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

TEST(Sha256Test, PublishedVector) {
  Sha256 hash;
  hash.Update("a");
  hash.Update("");
  hash.Update("bc");
  EXPECT_EQ(hash.HexDigest(), kAbc);
}

TEST(Sha256Test, HashesFiles) {
  const TempDir dir;
  WriteFile(dir.File("abc"), "abc");
  EXPECT_EQ(*HashFile(dir.File("abc")), kAbc);
  EXPECT_THAT(HashFile(dir.File("none")), StatusIs(StatusCode::kNotFound, "does not exist"));
}

}  // namespace
}  // namespace shiftmap::testing
