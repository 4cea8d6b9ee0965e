// SPDX-License-Identifier: Apache-2.0
#include "proto/mcap/compression.h"

#include <gtest/gtest.h>
#include <lz4frame.h>

#include <random>

#include "proto/mcap/format.h"

namespace shiftmap::mcap {
namespace {

std::string Compressible(std::size_t size) {
  std::mt19937 random(5);
  std::string bytes(size, 'a');
  for (std::size_t i = 0; i < size; i += 7) bytes[i] = static_cast<char>('a' + random() % 4);
  return bytes;
}

TEST(Compression, RoundTripsAtAllSizesAroundTheStep) {
  for (const std::size_t size : {std::size_t{0},
                                 std::size_t{1},
                                 std::size_t{1000},
                                 (std::size_t{1} << 18) - 1,
                                 std::size_t{1} << 18,
                                 (std::size_t{1} << 18) + 1,
                                 std::size_t{3'000'000}}) {
    const std::string bytes = Compressible(size);
    for (const Compression compression : {Compression::kNone, Compression::kZstd}) {
      const auto back =
          Decompress(CompressionName(compression), *Compress(compression, bytes), size);
      ASSERT_TRUE(back.ok()) << size << ": " << Message(back.status());
      EXPECT_EQ(*back, bytes);
    }
  }
}

TEST(Compression, JoinsZstdFrames) {
  const std::string frames =
      *Compress(Compression::kZstd, "first ") + *Compress(Compression::kZstd, "second");
  const auto back = Decompress("zstd", frames, 12);
  ASSERT_TRUE(back.ok()) << Message(back.status());
  EXPECT_EQ(*back, "first second");
}

TEST(Compression, RejectsAnotherSizeThanStated) {
  const std::string bytes = Compressible(1000);
  for (const Compression compression : {Compression::kNone, Compression::kZstd}) {
    const std::string stored = *Compress(compression, bytes);
    for (const std::uint64_t size : {std::uint64_t{0}, std::uint64_t{999}, std::uint64_t{1001}}) {
      EXPECT_EQ(Decompress(CompressionName(compression), stored, size).status().code(),
                StatusCode::kDataLoss);
    }
  }
}

TEST(Compression, RejectsEveryTruncatedFrame) {
  const std::string bytes = Compressible(300);
  const std::string stored = *Compress(Compression::kZstd, bytes);
  for (std::size_t length = 0; length < stored.size(); ++length) {
    EXPECT_EQ(Decompress("zstd", stored.substr(0, length), bytes.size()).status().code(),
              StatusCode::kDataLoss)
        << length;
  }
}

TEST(Compression, RejectsGarbage) {
  EXPECT_EQ(Decompress("zstd", "not zstd at all", 100).status().code(), StatusCode::kDataLoss);
}

TEST(Compression, StopsABombAtTheStatedSize) {
  const std::string bomb = *Compress(Compression::kZstd, std::string(std::size_t{64} << 20, '\0'));
  ASSERT_LT(bomb.size(), 10'000U);
  EXPECT_EQ(Decompress("zstd", bomb, 1000).status().code(), StatusCode::kDataLoss);
}

std::string Lz4Frame(const std::string& bytes) {
  std::string out(LZ4F_compressFrameBound(bytes.size(), nullptr), '\0');
  out.resize(LZ4F_compressFrame(out.data(), out.size(), bytes.data(), bytes.size(), nullptr));
  return out;
}

TEST(Compression, ReadsLz4Frames) {
  for (const std::size_t size : {std::size_t{1}, std::size_t{1000}, std::size_t{3'000'000}}) {
    const std::string bytes = Compressible(size);
    const auto back = Decompress("lz4", Lz4Frame(bytes), size);
    ASSERT_TRUE(back.ok()) << size << ": " << Message(back.status());
    EXPECT_EQ(*back, bytes);
    EXPECT_EQ(Decompress("lz4", Lz4Frame(bytes), size - 1).status().code(), StatusCode::kDataLoss);
    EXPECT_EQ(Decompress("lz4", Lz4Frame(bytes), size + 1).status().code(), StatusCode::kDataLoss);
  }
  EXPECT_EQ(*Decompress("lz4", Lz4Frame("first ") + Lz4Frame("second"), 12), "first second");
}

TEST(Compression, RejectsEveryTruncatedLz4Frame) {
  const std::string bytes = Compressible(300);
  const std::string stored = Lz4Frame(bytes);
  for (std::size_t length = 0; length < stored.size(); ++length) {
    EXPECT_FALSE(Decompress("lz4", stored.substr(0, length), bytes.size()).ok()) << length;
  }
}

TEST(Compression, NamesWhatItDoesNotRead) {
  const auto result = Decompress("bz2", "bytes", 5);
  EXPECT_EQ(result.status().code(), StatusCode::kInvalidArgument);
  EXPECT_NE(Message(result.status()).find("'bz2'"), std::string::npos);
}

}  // namespace
}  // namespace shiftmap::mcap
