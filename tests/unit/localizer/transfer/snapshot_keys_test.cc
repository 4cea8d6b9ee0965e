// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/snapshot_keys.h"

#include <gtest/gtest.h>
#include <openssl/evp.h>
#include <openssl/pem.h>

#include <cstdio>
#include <memory>

#include "mapstore/map/sha256.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::transfer {
namespace {

using ::shiftmap::testing::IsOk;
using ::shiftmap::testing::StatusIs;

struct Free {
  void operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }
  void operator()(EVP_MD_CTX* context) const { EVP_MD_CTX_free(context); }
};

// A site's signing key.
class SigningKey {
 public:
  SigningKey() : key_(EVP_PKEY_Q_keygen(nullptr, nullptr, "ED25519")) {}

  void WritePublic(const std::string& path) const {
    std::FILE* const file = std::fopen(path.c_str(), "w");
    PEM_write_PUBKEY(file, key_.get());
    std::fclose(file);
  }

  SnapshotSignature Sign(const std::string& text) const {
    std::string bytes(32, '\0');
    std::size_t size = bytes.size();
    EVP_PKEY_get_raw_public_key(key_.get(), reinterpret_cast<unsigned char*>(bytes.data()), &size);
    Sha256 hash;
    hash.Update(bytes);
    SnapshotSignature signature{hash.HexDigest(), std::string(64, '\0')};
    const std::unique_ptr<EVP_MD_CTX, Free> context(EVP_MD_CTX_new());
    EVP_DigestSignInit(context.get(), nullptr, nullptr, nullptr, key_.get());
    size = signature.signature.size();
    EVP_DigestSign(context.get(),
                   reinterpret_cast<unsigned char*>(signature.signature.data()),
                   &size,
                   reinterpret_cast<const unsigned char*>(text.data()),
                   text.size());
    return signature;
  }

 private:
  std::unique_ptr<EVP_PKEY, Free> key_;
};

class SnapshotKeysTest : public ::testing::Test {
 protected:
  SnapshotKeysTest() {
    snapshot_.area = "floor";
    snapshot_.version = VersionNumber(3);
    snapshot_.content_hash = "c0";
    snapshot_.ledger_sequence = LedgerPosition(17);
    snapshot_.sha256 = "ab";
    old_key_.WritePublic(folder_.File("old.pem"));
    new_key_.WritePublic(folder_.File("new.pem"));
  }

  SnapshotKeys Keys(const std::vector<std::string>& names) {
    std::vector<std::string> paths;
    for (const std::string& name : names) paths.push_back(folder_.File(name));
    StatusOr<SnapshotKeys> keys = SnapshotKeys::Read(paths);
    EXPECT_THAT(keys, IsOk());
    return *std::move(keys);
  }

  testing::TempDir folder_;
  SigningKey old_key_;
  SigningKey new_key_;
  SnapshotInfo snapshot_;
};

// The text of proto/map_server.proto.
TEST_F(SnapshotKeysTest, TheSignedTextIsThatOfTheInterface) {
  EXPECT_EQ(SignedText(snapshot_), "shiftmap-snapshot\nfloor\n3\nc0\n17\nab\n");
}

TEST_F(SnapshotKeysTest, WhileKeysChangeEitherOfTwoIsBelieved) {
  snapshot_.signatures = {old_key_.Sign(SignedText(snapshot_)),
                          new_key_.Sign(SignedText(snapshot_))};
  EXPECT_THAT(Keys({"old.pem"}).Verify(snapshot_), IsOk());
  EXPECT_THAT(Keys({"new.pem"}).Verify(snapshot_), IsOk());
  snapshot_.signatures.erase(snapshot_.signatures.begin());
  EXPECT_THAT(Keys({"old.pem", "new.pem"}).Verify(snapshot_), IsOk());
  EXPECT_THAT(Keys({"old.pem"}).Verify(snapshot_),
              StatusIs(StatusCode::kDataLoss, "by other keys"));
}

TEST_F(SnapshotKeysTest, AnythingElseThanWhatWasSignedIsRefused) {
  snapshot_.signatures = {old_key_.Sign(SignedText(snapshot_))};
  const SnapshotKeys keys = Keys({"old.pem"});
  const auto expect_refused = [&](const SnapshotInfo& changed) {
    EXPECT_THAT(keys.Verify(changed), StatusIs(StatusCode::kDataLoss, "wrong"));
  };
  SnapshotInfo changed = snapshot_;
  changed.area = "yard";
  expect_refused(changed);
  changed = snapshot_;
  changed.version = VersionNumber(4);
  expect_refused(changed);
  changed = snapshot_;
  changed.content_hash = "c1";
  expect_refused(changed);
  changed = snapshot_;
  changed.ledger_sequence = LedgerPosition(18);
  expect_refused(changed);
  changed = snapshot_;
  changed.sha256 = "ac";
  expect_refused(changed);
  changed = snapshot_;
  changed.signatures[0].signature[5] ^= 1;
  expect_refused(changed);
  changed.signatures[0].signature.clear();
  expect_refused(changed);
}

TEST_F(SnapshotKeysTest, UnsignedIsRefusedWhereThereIsAKeyAndBelievedWhereThereIsNone) {
  EXPECT_THAT(Keys({"old.pem"}).Verify(snapshot_), StatusIs(StatusCode::kDataLoss, "not signed"));
  EXPECT_THAT(Keys({}).Verify(snapshot_), IsOk());
}

TEST_F(SnapshotKeysTest, OtherFilesAreNoKeys) {
  testing::WriteFile(folder_.File("x.pem"), "-----BEGIN PUBLIC KEY-----\nAAAA\n");
  EXPECT_THAT(SnapshotKeys::Read({folder_.File("x.pem")}),
              StatusIs(StatusCode::kInvalidArgument, "x.pem"));
  const std::unique_ptr<EVP_PKEY, Free> other(EVP_PKEY_Q_keygen(nullptr, nullptr, "X25519"));
  std::FILE* const file = std::fopen(folder_.File("x.pem").c_str(), "w");
  PEM_write_PUBKEY(file, other.get());
  std::fclose(file);
  EXPECT_THAT(SnapshotKeys::Read({folder_.File("x.pem")}),
              StatusIs(StatusCode::kInvalidArgument, "Ed25519"));
  EXPECT_THAT(SnapshotKeys::Read({folder_.File("no.pem")}),
              StatusIs(StatusCode::kNotFound, "no.pem"));
}

}  // namespace
}  // namespace shiftmap::transfer
