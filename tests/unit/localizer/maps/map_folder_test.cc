// SPDX-License-Identifier: Apache-2.0
#include "localizer/maps/map_folder.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <random>
#include <string>
#include <vector>

#include "localizer/maps/map_file_name.h"
#include "mapstore/map/sha256.h"
#include "mapstore/map_store.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

namespace fs = std::filesystem;

class MapFolderTest : public ::testing::Test {
 protected:
  // A snapshot of an area in a file of its own.
  std::string Snapshot(const std::string& area, std::uint64_t seed) {
    const std::string store_path = dir_.File("store.db");
    fs::remove(store_path);
    auto store = MapStore::Open(store_path, MapStore::Access::kReadWriteCreate);
    std::mt19937_64 random(seed);
    EXPECT_THAT(store, testing::IsOk());
    EXPECT_THAT(store->Commit(area, testing::RandomContent(random), Provenance(), CommitOptions()),
                testing::IsOk());
    const std::string path = dir_.File("snapshot-" + std::to_string(++snapshots_) + ".db");
    EXPECT_THAT(store->ExportSnapshot(area, path), testing::IsOk());
    return path;
  }

  MapFolder Opened(const MapFolderOptions& options = MapFolderOptions()) {
    auto folder = MapFolder::Open(dir_.File("maps"), options);
    EXPECT_THAT(folder, testing::IsOk());
    return *std::move(folder);
  }

  static FolderMap Added(MapFolder* folder, const std::string& path) {
    const auto map = folder->Add(path);
    EXPECT_THAT(map, testing::IsOk());
    return map.ok() ? *map : FolderMap();
  }

  static std::vector<std::string> EnabledVersions(const MapFolder& folder) {
    std::vector<std::string> versions;
    const auto maps = folder.List();
    EXPECT_THAT(maps, testing::IsOk());
    for (const FolderMap& map : *maps) {
      if (map.enabled) versions.push_back(map.map_version);
    }
    return versions;
  }

  testing::TempDir dir_;
  int snapshots_ = 0;
};

TEST_F(MapFolderTest, MapThatIsAddedIsListedDisabledWithItsHashInItsName) {
  MapFolder folder = Opened();
  const std::string file = Snapshot("level 3/<b>", 1);
  const FolderMap map = Added(&folder, file);
  const auto maps = folder.List();
  ASSERT_THAT(maps, testing::IsOk());
  ASSERT_EQ(maps->size(), 1u);
  EXPECT_EQ(maps->front().map_id, "level 3/<b>");
  EXPECT_EQ(maps->front().sha256, *HashFile(file));
  EXPECT_EQ(maps->front().bytes, static_cast<std::int64_t>(fs::file_size(file)));
  EXPECT_FALSE(maps->front().enabled);
  const auto loaded = LoadSnapshotFile(map.path);
  ASSERT_THAT(loaded, testing::IsOk());
  EXPECT_EQ(map.map_version,
            "1-" + loaded->content_hash().substr(0, 8) + "-" + map.sha256.substr(0, 8));
}

TEST_F(MapFolderTest, OneVersionOfAnAreaIsEnabledAndOtherAreasStayAsTheyAre) {
  MapFolder folder = Opened();
  const FolderMap a = Added(&folder, Snapshot("a", 1));
  const FolderMap b = Added(&folder, Snapshot("a", 2));
  const FolderMap other = Added(&folder, Snapshot("b", 3));
  ASSERT_THAT(folder.Enable("a", a.map_version), testing::IsOk());
  ASSERT_THAT(folder.Enable("b", other.map_version), testing::IsOk());
  ASSERT_THAT(folder.Enable("a", b.map_version), testing::IsOk());
  EXPECT_EQ(EnabledVersions(Opened()),
            (std::vector<std::string>{b.map_version, other.map_version}));
  EXPECT_EQ((*folder.Enabled("a"))->map_version, b.map_version);
  EXPECT_FALSE(*folder.Enabled("c"));
  EXPECT_EQ(folder.Enable("a", "9-0-0").code(), StatusCode::kNotFound);
  EXPECT_EQ((*folder.Enabled("a"))->map_version, b.map_version);
}

TEST_F(MapFolderTest, MapIsRemovedOnlyWhileNobodyUsesIt) {
  MapFolder folder = Opened();
  const FolderMap a = Added(&folder, Snapshot("a", 1));
  const FolderMap b = Added(&folder, Snapshot("a", 2));
  ASSERT_THAT(folder.Enable("a", a.map_version), testing::IsOk());
  EXPECT_EQ(folder.Remove("a", a.map_version).code(), StatusCode::kFailedPrecondition);
  {
    const auto use = Opened().Use(b);
    ASSERT_THAT(use, testing::IsOk());
    EXPECT_EQ(folder.Remove("a", b.map_version).code(), StatusCode::kFailedPrecondition);
  }
  EXPECT_THAT(folder.Remove("a", b.map_version), testing::IsOk());
  EXPECT_EQ(folder.Remove("a", b.map_version).code(), StatusCode::kNotFound);
  EXPECT_EQ(folder.Use(b).status().code(), StatusCode::kNotFound);
  EXPECT_EQ(folder.List()->size(), 1u);
}

TEST_F(MapFolderTest, FileThatIsNotTheExpectedMapLeavesTheFolderAsItWas) {
  MapFolder folder = Opened();
  const std::string file = Snapshot("a", 1);
  const auto code = [&](const std::string& path, const ExpectedMap& expected) {
    return folder.Add(path, expected).status().code();
  };
  EXPECT_EQ(code(dir_.File("none"), {}), StatusCode::kNotFound);
  EXPECT_EQ(code(file, {.map_id = "", .map_version = "", .sha256 = std::string(64, '0')}),
            StatusCode::kDataLoss);
  EXPECT_EQ(code(file, {.map_id = "b", .map_version = "", .sha256 = ""}),
            StatusCode::kFailedPrecondition);
  EXPECT_EQ(code(file, {.map_id = "a", .map_version = "1-0-0", .sha256 = ""}),
            StatusCode::kFailedPrecondition);
  testing::WriteFile(dir_.File("text"), "no map");
  EXPECT_FALSE(folder.Add(dir_.File("text")).ok());
  std::string cut = testing::ReadFile(file);
  cut.resize(cut.size() / 2);
  testing::WriteFile(dir_.File("cut"), cut);
  EXPECT_FALSE(folder.Add(dir_.File("cut")).ok());
  EXPECT_TRUE(folder.List()->empty());

  const FolderMap map = Added(&folder, file);
  EXPECT_EQ(code(file, {}), StatusCode::kAlreadyExists);
  std::string upper = map.sha256;
  for (char& c : upper) c = static_cast<char>(std::toupper(c));
  ASSERT_THAT(folder.Remove("a", map.map_version), testing::IsOk());
  EXPECT_THAT(folder.Add(file, {"a", map.map_version, upper}), testing::IsOk());
}

TEST_F(MapFolderTest, SizeAndNumberAreBounded) {
  const std::string file = Snapshot("a", 1);
  const auto bytes = static_cast<std::int64_t>(fs::file_size(file));
  MapFolder small = Opened({.max_bytes = 2 * bytes - 1, .max_maps = 64});
  Added(&small, file);
  const auto refused = small.Add(Snapshot("a", 2));
  EXPECT_EQ(refused.status().code(), StatusCode::kResourceExhausted);
  EXPECT_NE(Message(refused.status()).find("remove maps"), std::string::npos);
  MapFolder few = Opened({.max_bytes = 100 * bytes, .max_maps = 1});
  EXPECT_EQ(few.Add(Snapshot("a", 2)).status().code(), StatusCode::kResourceExhausted);
}

// Every state that a cut can leave on disk: what was done of a change, and not the rest.
TEST_F(MapFolderTest, CutAtAnyPointOfAChangeLeavesTheStateBeforeOrAfterIt) {
  MapFolder folder = Opened();
  const FolderMap a = Added(&folder, Snapshot("a", 1));
  const FolderMap b = Added(&folder, Snapshot("a", 2));
  ASSERT_THAT(folder.Enable("a", a.map_version), testing::IsOk());
  // While a map is added, and while the list is replaced: leftovers beside what was there.
  const std::string incoming = *folder.Incoming("x");
  testing::WriteFile(incoming, testing::ReadFile(a.path).substr(0, 1000));
  testing::WriteFile(folder.path() + "/enabled.tmp-0", fs::path(b.path).filename().string());
  EXPECT_EQ(folder.List()->size(), 2u);
  EXPECT_EQ(EnabledVersions(folder), (std::vector<std::string>{a.map_version}));
  // The list names a map whose removal was done by hand.
  ASSERT_THAT(folder.Enable("a", b.map_version), testing::IsOk());
  fs::remove(b.path);
  EXPECT_TRUE(EnabledVersions(folder).empty());
  ASSERT_THAT(folder.Enable("a", a.map_version), testing::IsOk());
  EXPECT_EQ(EnabledVersions(folder), (std::vector<std::string>{a.map_version}));
  // The next download removes what an ended one left.
  EXPECT_EQ(*folder.Incoming("x"), incoming);
  EXPECT_TRUE(fs::exists(incoming));
  EXPECT_NE(*folder.Incoming("y"), incoming);
  EXPECT_FALSE(fs::exists(incoming));
}

TEST_F(MapFolderTest, ProcessesThatChangeItAtOnceLoseNothing) {
  constexpr int kProcesses = 4;
  std::vector<std::string> files;
  for (int i = 0; i < kProcesses; ++i) {
    files.push_back(Snapshot("area-" + std::to_string(i), static_cast<std::uint64_t>(i)));
  }
  std::vector<pid_t> children;
  for (int i = 0; i < kProcesses; ++i) {
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      auto folder = MapFolder::Open(dir_.File("maps"));
      const auto map = folder->Add(files[static_cast<std::size_t>(i)]);
      const Status done = map.ok() ? folder->Enable(map->map_id, map->map_version) : map.status();
      if (!done.ok()) std::fprintf(stderr, "%s\n", Message(done).c_str());
      _exit(done.ok() ? 0 : 1);
    }
    children.push_back(child);
  }
  for (const pid_t child : children) {
    int status = -1;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    EXPECT_EQ(status, 0);
  }
  EXPECT_EQ(EnabledVersions(Opened()).size(), static_cast<std::size_t>(kProcesses));
}

TEST_F(MapFolderTest, KilledAtAnyMomentItHoldsWholeMapsAndAtMostOneEnabled) {
  const std::vector<std::string> files = {Snapshot("a", 1), Snapshot("a", 2), Snapshot("a", 3)};
  std::mt19937_64 random(testing::TestSeed(17));
  std::size_t listed = 0;
  for (int life = 0; life < 40; ++life) {
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      auto folder = MapFolder::Open(dir_.File("maps"));
      for (std::size_t i = 0;; ++i) {
        const auto map = folder->Add(files[i % files.size()]);
        if (map.ok()) folder->Enable(map->map_id, map->map_version).IgnoreError();
        const auto maps = folder->List();
        for (const FolderMap& old : *maps) {
          if (!old.enabled) folder->Remove(old.map_id, old.map_version).IgnoreError();
        }
      }
    }
    usleep(std::uniform_int_distribution<useconds_t>(500, 30'000)(random));
    kill(child, SIGKILL);
    ASSERT_EQ(waitpid(child, nullptr, 0), child);
    const MapFolder folder = Opened();
    const auto maps = folder.List();
    ASSERT_THAT(maps, testing::IsOk());
    for (const FolderMap& map : *maps) {
      EXPECT_EQ(*HashFile(map.path), map.sha256);
      EXPECT_THAT(LoadSnapshotFile(map.path), testing::IsOk());
    }
    EXPECT_LE(EnabledVersions(folder).size(), 1u);
    listed += maps->size();
  }
  EXPECT_GT(listed, 20u);
  // What the killed ones left does not stand in the way.
  MapFolder folder = Opened();
  for (const std::string& file : files) {
    const auto added = folder.Add(file);
    EXPECT_TRUE(added.ok() || added.status().code() == StatusCode::kAlreadyExists);
  }
  EXPECT_EQ(folder.List()->size(), files.size());
}

TEST_F(MapFolderTest, FileNamesAreReadBackAndOthersAreNone) {
  const std::string sha256(64, 'a');
  for (const std::string& map_id : {std::string("level-3"),
                                    std::string("..", 2),
                                    std::string("a@b%/\n\0\xff", 8),
                                    std::string(1, '.')}) {
    const FolderMap map{
        .map_id = map_id, .map_version = "1-00000000-aaaaaaaa", .sha256 = sha256, .path = ""};
    const auto name = MapFileName(map);
    ASSERT_THAT(name, testing::IsOk());
    EXPECT_EQ(name->find('/'), std::string::npos);
    EXPECT_NE(name->front(), '.');
    const auto read = ParseMapFileName(*name);
    ASSERT_TRUE(read);
    EXPECT_EQ(read->map_id, map_id);
    EXPECT_EQ(read->map_version, map.map_version);
    EXPECT_EQ(read->sha256, sha256);
  }
  for (const std::string& name : {std::string("enabled"),
                                  "a@1-00000000-bbbbbbbb@" + sha256 + ".db",
                                  "%61@1-00000000-aaaaaaaa@" + sha256 + ".db",
                                  "a@1-00000000-aaaaaaaa@" + sha256 + ".db.tmp-0",
                                  std::string("a@1-00000000-aaaaaaaa@aaaaaaaa.db")}) {
    EXPECT_FALSE(ParseMapFileName(name)) << name;
  }
  const FolderMap longest{
      .map_id = std::string(200, 'x'), .map_version = "1", .sha256 = sha256, .path = ""};
  EXPECT_EQ(MapFileName(longest).status().code(), StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace shiftmap
