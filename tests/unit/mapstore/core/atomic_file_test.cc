// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/atomic_file.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>
#include <vector>

namespace shiftmap {
namespace {

class AtomicFileTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (std::filesystem::temp_directory_path() / "shiftmap_XXXXXX").string();
    ASSERT_NE(mkdtemp(pattern.data()), nullptr);
    folder_ = pattern;
    path_ = folder_ / "file";
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string Content() const {
    std::ifstream file(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  void Put(const std::string& text) const { std::ofstream(path_) << text; }
  auto FilesInFolder() const {
    return std::distance(std::filesystem::directory_iterator(folder_), {});
  }

  std::filesystem::path folder_;
  std::filesystem::path path_;
};

TEST_F(AtomicFileTest, AppearsOnCommitOnly) {
  auto file = AtomicFile::Create(path_);
  ASSERT_TRUE(file.ok()) << Message(file.status());
  ASSERT_TRUE(file->Append("first ").ok());
  ASSERT_TRUE(file->Append("second").ok());
  EXPECT_FALSE(std::filesystem::exists(path_));
  ASSERT_TRUE(file->Commit().ok());
  EXPECT_EQ(Content(), "first second");
  EXPECT_EQ(FilesInFolder(), 1);
}

TEST_F(AtomicFileTest, ReplacesOnCommit) {
  Put("old");
  auto file = AtomicFile::Create(path_);
  ASSERT_TRUE(file.ok() && file->Append("other").ok());
  EXPECT_EQ(Content(), "old");
  ASSERT_TRUE(file->Commit().ok());
  EXPECT_EQ(Content(), "other");
}

// A mistyped name must not cost a site its memory.
TEST_F(AtomicFileTest, ReplacesALogOrADatabaseByItsKindOnly) {
  constexpr FileKind kKinds[] = {FileKind::kOther, FileKind::kRunLog, FileKind::kDatabase};
  const std::string content[] = {
      "text", "\x89MCAP0\r\nrest of it", std::string("SQLite format 3\0pages", 21)};
  for (const std::size_t there : {0u, 1u, 2u}) {
    for (const std::size_t now : {0u, 1u, 2u}) {
      Put(content[there]);
      const bool allowed = there == 0 || there == now;
      auto file = AtomicFile::Create(path_, kKinds[now]);
      EXPECT_EQ(file.ok(), allowed) << there << now;
      if (!allowed) {
        EXPECT_EQ(file.status().code(), StatusCode::kInvalidArgument);
      }
      EXPECT_EQ(Content(), content[there]);
    }
  }
}

TEST_F(AtomicFileTest, LeavesNothingBehindWithoutCommit) {
  Put("old");
  {
    auto file = AtomicFile::Create(path_);
    ASSERT_TRUE(file.ok() && file->Append("other").ok());
    AtomicFile moved = *std::move(file);
  }
  EXPECT_EQ(Content(), "old");
  EXPECT_EQ(FilesInFolder(), 1);
}

TEST_F(AtomicFileTest, NeedsAFolderAndARegularTarget) {
  EXPECT_EQ(AtomicFile::Create(folder_ / "none" / "file").status().code(), StatusCode::kNotFound);
  EXPECT_EQ(AtomicFile::Create(folder_).status().code(), StatusCode::kInvalidArgument);
  EXPECT_EQ(AtomicFile::Create("/dev/null").status().code(), StatusCode::kInvalidArgument);
}

TEST_F(AtomicFileTest, TwoAtOnceDoNotMeet) {
  auto first = AtomicFile::Create(path_);
  auto second = AtomicFile::Create(path_);
  ASSERT_TRUE(first.ok() && second.ok());
  ASSERT_TRUE(first->Append("first").ok() && second->Append("second").ok());
  ASSERT_TRUE(second->Commit().ok());
  EXPECT_EQ(Content(), "second");
  ASSERT_TRUE(first->Commit().ok());
  EXPECT_EQ(Content(), "first");
}

TEST_F(AtomicFileTest, TheNextOneRemovesWhatAKilledProcessLeft) {
  const pid_t child = fork();
  if (child == 0) {
    auto file = AtomicFile::Create(path_);
    _exit(file.ok() && file->Append("half").ok() ? 0 : 1);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_EQ(status, 0);
  EXPECT_EQ(FilesInFolder(), 1);
  ASSERT_TRUE(WriteFileAtomically(path_, "whole").ok());
  EXPECT_EQ(Content(), "whole");
  EXPECT_EQ(FilesInFolder(), 1);
}

TEST_F(AtomicFileTest, WhatALiveOneWritesAndWhatIsNoFileStays) {
  auto live = AtomicFile::Create(path_);
  ASSERT_TRUE(live.ok() && live->Append("live").ok());
  const std::filesystem::path victim = folder_ / "victim";
  std::ofstream(victim) << "precious";
  std::filesystem::create_symlink(victim, path_.string() + ".tmp-1");
  std::filesystem::create_directory(path_.string() + ".tmp-2");
  ASSERT_TRUE(WriteFileAtomically(path_, "other").ok());
  EXPECT_TRUE(std::filesystem::is_symlink(path_.string() + ".tmp-1"));
  ASSERT_TRUE(live->Commit().ok());
  EXPECT_EQ(Content(), "live");
  EXPECT_EQ(std::filesystem::file_size(victim), 8U);
}

TEST_F(AtomicFileTest, ManyWritersAtOnceNeverMeet) {
  constexpr int kWriters = 8;
  std::vector<std::thread> writers;
  for (int i = 0; i < kWriters; ++i) {
    writers.emplace_back([&, i] {
      for (int j = 0; j < 25; ++j) {
        const Status status =
            WriteFileAtomically(path_, std::string(1000, static_cast<char>('a' + i)));
        EXPECT_TRUE(status.ok()) << Message(status);
        const std::string content = Content();
        EXPECT_EQ(content, std::string(1000, content.front()));
      }
    });
  }
  for (std::thread& writer : writers) writer.join();
  EXPECT_EQ(FilesInFolder(), 1);
}

TEST_F(AtomicFileTest, RenamesWhatSomebodyElseWrote) {
  const std::filesystem::path temporary = folder_ / "temporary";
  std::ofstream(temporary) << "theirs";
  ASSERT_TRUE(SyncAndRename(temporary, path_).ok());
  EXPECT_EQ(Content(), "theirs");
  EXPECT_EQ(FilesInFolder(), 1);
  EXPECT_EQ(SyncAndRename(temporary, path_).code(), StatusCode::kNotFound);
}

}  // namespace
}  // namespace shiftmap
