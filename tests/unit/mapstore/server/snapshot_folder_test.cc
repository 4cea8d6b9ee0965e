// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/snapshot_folder.h"

#include <gtest/gtest.h>
#include <openssl/evp.h>
#include <openssl/pem.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "mapstore/map/sha256.h"
#include "mapstore/server/snapshot_keeper.h"
#include "mapstore/server/store_writer.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/mapstore/store/store_test_util.h"

namespace shiftmap::server {
namespace {

using shiftmap::testing::At;
using shiftmap::testing::EmptyReport;
using shiftmap::testing::IsOk;
using shiftmap::testing::OpenStore;
using shiftmap::testing::ReadFile;
using shiftmap::testing::StatusIs;
using shiftmap::testing::TempDir;
using shiftmap::testing::TwoStateContent;
using shiftmap::testing::WriteFile;

class SnapshotFolderTest : public ::testing::Test {
 protected:
  CommitResult Commit(const std::string& area = "floor") {
    return *store_.Commit(
        area, TwoStateContent(1e-5, 0.5, At(static_cast<double>(++commits_))), {}, {});
  }

  std::unique_ptr<SnapshotFolder> Open(double keep_s = 1000.0,
                                       std::vector<SnapshotSigner> signers = {}) const {
    StatusOr<std::unique_ptr<SnapshotFolder>> folder =
        SnapshotFolder::Open(path_, std::move(signers), keep_s);
    EXPECT_THAT(folder, IsOk());
    return *std::move(folder);
  }

  bool IsThere(const std::string& sha256) const {
    return std::filesystem::exists(path_ + "/" + sha256 + ".db");
  }

  EVP_PKEY* MakeKey(const std::string& name) const {
    EVP_PKEY* const key = EVP_PKEY_Q_keygen(nullptr, nullptr, "ED25519");
    FILE* const file = std::fopen(dir_.File(name).c_str(), "w");
    PEM_write_PrivateKey(file, key, nullptr, nullptr, 0, nullptr, nullptr);
    std::fclose(file);
    return key;
  }

  std::vector<SnapshotSigner> Signers(const std::string& name) const {
    StatusOr<SnapshotSigner> signer = SnapshotSigner::Read(dir_.File(name));
    EXPECT_THAT(signer, IsOk());
    std::vector<SnapshotSigner> signers;
    signers.push_back(*std::move(signer));
    return signers;
  }

  TempDir dir_;
  std::string path_ = dir_.File("snapshots");
  MapStore store_ = OpenStore(dir_.File("maps.db"));
  int commits_ = 0;
};

TEST_F(SnapshotFolderTest, ASnapshotIsAFileNamedByItsHashThatTheIndexNames) {
  const CommitResult version = Commit("../<b>");
  const auto folder = Open();
  const auto made = folder->Make(store_, "../<b>", 7);
  ASSERT_THAT(made, IsOk());
  EXPECT_EQ(*HashFile(path_ + "/" + made->sha256 + ".db"), made->sha256);
  EXPECT_EQ(made->version, version.version);
  EXPECT_EQ(made->content_hash, version.content_hash);
  const auto index = nlohmann::json::parse(ReadFile(path_ + "/=2E.=2F=3Cb=3E.json"));
  EXPECT_EQ(index["area"], "../<b>");
  EXPECT_EQ(index["file"], made->sha256 + ".db");
  EXPECT_EQ(index["size_bytes"], std::filesystem::file_size(path_ + "/" + made->sha256 + ".db"));
  EXPECT_THAT(folder->OpenFile("floor", ""), StatusIs(StatusCode::kNotFound, "no snapshot"));
}

TEST_F(SnapshotFolderTest, AnotherServerTakesUpWhatOneLeft) {
  Commit();
  std::string sha256;
  {
    const auto folder = Open();
    sha256 = folder->Make(store_, "floor", 7)->sha256;
    EXPECT_THAT(SnapshotFolder::Open(path_, {}, 1.0),
                StatusIs(StatusCode::kUnavailable, "another server"));
  }
  WriteFile(path_ + "/" + std::string(64, 'a') + ".db", "of a server that was killed");
  WriteFile(path_ + "/new-floor", "of a server that was killed");
  WriteFile(path_ + "/README", "not ours");
  WriteFile(path_ + "/broken.json", "{");
  const auto folder = Open();
  EXPECT_EQ(folder->Newest("floor")->sha256, sha256);
  EXPECT_EQ(folder->Change("floor"), 7);
  EXPECT_FALSE(IsThere(std::string(64, 'a')));
  EXPECT_FALSE(std::filesystem::exists(path_ + "/new-floor"));
  EXPECT_TRUE(std::filesystem::exists(path_ + "/README"));
}

TEST_F(SnapshotFolderTest, AnOldSnapshotIsRemovedOnceNobodyReadsIt) {
  Commit();
  const auto folder = Open(/*keep_s=*/0.0);
  const std::string first = folder->Make(store_, "floor", 1)->sha256;
  auto reader = folder->OpenFile("floor", "");
  ASSERT_THAT(reader, IsOk());
  Commit();
  const std::string second = folder->Make(store_, "floor", 2)->sha256;
  folder->RemoveOld();
  EXPECT_TRUE(IsThere(first));
  EXPECT_THAT(folder->OpenFile("floor", first), IsOk());
  reader = NotFound("closed");
  folder->RemoveOld();
  EXPECT_FALSE(IsThere(first));
  EXPECT_THAT(folder->OpenFile("floor", first), StatusIs(StatusCode::kNotFound, first));
  EXPECT_TRUE(IsThere(second));
}

// What starts to sign, or changes its key, has a snapshot already that vehicles will ask for.
TEST_F(SnapshotFolderTest, TheKeeperSignsWhatItHasWithAnotherKey) {
  Commit();
  JsonLog log(nullptr, JsonLog::Level::kOff);
  SnapshotFeed feed;
  const auto key_of_newest = [&](std::vector<SnapshotSigner> signers) {
    const auto folder = Open(1000.0, std::move(signers));
    const SnapshotKeeper keeper(OpenStore(dir_.File("maps.db")), {}, folder.get(), &feed, &log);
    const std::optional<SnapshotInfo> newest = folder->Newest("floor");
    return newest->signatures.empty() ? "" : newest->signatures.front().key_sha256;
  };
  EXPECT_EQ(key_of_newest({}), "");
  for (const std::string name : {"first.pem", "second.pem"}) {
    EVP_PKEY_free(MakeKey(name));
    const std::string id = Signers(name).front().key_sha256();
    EXPECT_EQ(key_of_newest(Signers(name)), id);
  }
}

TEST_F(SnapshotFolderTest, ASignatureHoldsForTheTextThatIsDocumented) {
  EVP_PKEY* const key = MakeKey("key.pem");
  Commit();
  const auto made = Open(1.0, Signers("key.pem"))->Make(store_, "floor", 1);
  ASSERT_EQ(made->signatures.size(), 1u);
  const std::string text =
      "shiftmap-snapshot\nfloor\n1\n" + made->content_hash + "\n0\n" + made->sha256 + "\n";
  const std::string& signature = made->signatures.front().signature;
  const auto verify = [&](const std::string& signed_text) {
    EVP_MD_CTX* const digest = EVP_MD_CTX_new();
    EVP_DigestVerifyInit(digest, nullptr, nullptr, nullptr, key);
    const int valid = EVP_DigestVerify(digest,
                                       reinterpret_cast<const unsigned char*>(signature.data()),
                                       signature.size(),
                                       reinterpret_cast<const unsigned char*>(signed_text.data()),
                                       signed_text.size());
    EVP_MD_CTX_free(digest);
    return valid == 1;
  };
  EXPECT_TRUE(verify(text));
  EXPECT_FALSE(verify(text + "\n"));
  std::string raw(32, '\0');
  std::size_t size = raw.size();
  EVP_PKEY_get_raw_public_key(key, reinterpret_cast<unsigned char*>(raw.data()), &size);
  Sha256 hash;
  hash.Update(raw);
  EXPECT_EQ(made->signatures.front().key_sha256, hash.HexDigest());
  EVP_PKEY_free(key);
  WriteFile(dir_.File("other.pem"), "no key");
  EXPECT_THAT(SnapshotSigner::Read(dir_.File("other.pem")),
              StatusIs(StatusCode::kInvalidArgument, "Ed25519"));
}

TEST_F(SnapshotFolderTest, TheKeeperMakesOneForEachVersionAndForRowsOnceAnInterval) {
  const CommitResult version = Commit();
  const auto folder = Open();
  std::ostringstream out;
  JsonLog log(&out, JsonLog::Level::kInfo);
  SnapshotFeed feed;
  std::atomic<std::int64_t> told = 0;
  feed.Join("floor", [&](const SnapshotInfo& snapshot) { told = snapshot.version.value(); });
  const auto wait = [&](const std::function<bool()>& until) {
    for (int i = 0; i < 5000 && !until(); ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    return until();
  };
  {
    const SnapshotKeeper keeper(OpenStore(dir_.File("maps.db")),
                                {.poll_s = 0.01, .interval_s = 1e5},
                                folder.get(),
                                &feed,
                                &log);
    EXPECT_EQ(told, 1);
    EXPECT_EQ(keeper.areas().size(), 1u);
    ASSERT_THAT(store_.Return(EmptyReport(version, "floor", 1)), IsOk());
    Commit();
    EXPECT_TRUE(wait([&] { return told == 2; }));
  }
  // Rows alone wait for the interval, and what was published in between does not come twice.
  ASSERT_THAT(store_.Return(EmptyReport(version, "floor", 2)), IsOk());
  const auto before = folder->Newest("floor");
  const SnapshotKeeper patient(OpenStore(dir_.File("maps.db")),
                               {.poll_s = 0.01, .interval_s = 1e5},
                               folder.get(),
                               &feed,
                               &log);
  EXPECT_EQ(folder->Newest("floor")->sha256, before->sha256);
  const SnapshotKeeper eager(OpenStore(dir_.File("maps.db")),
                             {.poll_s = 0.01, .interval_s = 0.0},
                             folder.get(),
                             &feed,
                             &log);
  EXPECT_EQ(folder->Newest("floor")->ledger_sequence.value(), 2);
}

TEST_F(SnapshotFolderTest, TheWriterTellsEachReportItsOwnFate) {
  const CommitResult version = Commit();
  StoreWriter writer(OpenStore(dir_.File("maps.db")), 100);
  std::vector<StatusOr<ReturnResult>> results(40, StatusOr<ReturnResult>(ReturnResult()));
  std::vector<std::thread> threads;
  for (int i = 0; i < 40; ++i) {
    threads.emplace_back([&, i] {
      ShiftReport report = EmptyReport(version, i % 4 == 3 ? "attic" : "floor", i / 2);
      results[static_cast<std::size_t>(i)] = writer.Return(report, "truck");
    });
  }
  for (std::thread& thread : threads) thread.join();
  int duplicates = 0;
  for (std::size_t i = 0; i < results.size(); ++i) {
    // Of an odd pair one names an area that is none; whether its UUID is known already is chance.
    if (results[i].ok()) {
      duplicates += results[i]->duplicate ? 1 : 0;
    } else {
      EXPECT_EQ(i % 4, 3u);
      EXPECT_THAT(results[i], StatusIs(StatusCode::kNotFound, "attic"));
    }
  }
  EXPECT_EQ(store_.Reports("floor")->size(), 20u);
  EXPECT_GE(duplicates, 10);
  writer.Stop();
  EXPECT_THAT(writer.Return(EmptyReport(version, "floor", 99), "truck"),
              StatusIs(StatusCode::kUnavailable, "stopping"));
}

TEST_F(SnapshotFolderTest, ReportsTogetherAreWhatTheyAreOneByOne) {
  const CommitResult version = Commit();
  std::vector<AttributedReport> reports;
  for (const int number : {1, 2, 1, 3})
    reports.push_back({EmptyReport(version, "floor", number), "v"});
  reports[1].report.content_hash = std::string(64, '0');
  reports[3].report.vehicle.clear();
  const auto results = store_.ReturnAll(reports);
  ASSERT_EQ(results.size(), 4u);
  EXPECT_THAT(results[0], IsOk());
  EXPECT_THAT(results[1], StatusIs(StatusCode::kInvalidArgument, "content hash"));
  ASSERT_THAT(results[2], IsOk());
  EXPECT_TRUE(results[2]->duplicate);
  EXPECT_THAT(results[3], StatusIs(StatusCode::kInvalidArgument, "vehicle"));
  EXPECT_EQ(store_.Reports("floor")->size(), 1u);
}

TEST_F(SnapshotFolderTest, ChangesCountHeldReportsAndWhatReadersSee) {
  const CommitResult version = Commit();
  const std::int64_t begin = store_.ChangesSince(0)->position;
  EXPECT_EQ(store_.ChangesSince(begin)->areas.front().last_change, 0);
  const ShiftReport report = EmptyReport(version, "floor", 1);
  ASSERT_THAT(store_.Return(report), IsOk());
  EXPECT_GT(store_.ChangesSince(begin)->areas.front().last_change, begin);
  EXPECT_EQ(store_.ChangesSince(begin)->areas.front().held_reports, 0);
  Exclusion hold;
  hold.run = report.uuid;
  hold.reason = "odd";
  hold.held = true;
  ASSERT_THAT(store_.Exclude("floor", hold), IsOk());
  const auto changes = store_.ChangesSince(begin);
  EXPECT_EQ(changes->areas.front().held_reports, 1);
  EXPECT_EQ(changes->areas.front().published, version.version);
  // A restored backup that tells of less: all is new.
  EXPECT_GT(store_.ChangesSince(changes->position + 5)->areas.front().last_change, 0);
}

}  // namespace
}  // namespace shiftmap::server
