// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/snapshot_signer.h"

#include <openssl/evp.h>

#include <array>
#include <utility>

#include "mapstore/core/input_file.h"
#include "mapstore/core/pem.h"
#include "mapstore/map/sha256.h"
#include "proto/core/check.h"

namespace shiftmap::server {
namespace {

constexpr std::size_t kMaxKeyBytes = std::size_t{64} << 10;
constexpr std::size_t kPublicKeyBytes = 32;
constexpr std::size_t kSignatureBytes = 64;

struct FreeDigest {
  void operator()(EVP_MD_CTX* digest) const { EVP_MD_CTX_free(digest); }
};

const unsigned char* Bytes(const std::string& text) {
  return reinterpret_cast<const unsigned char*>(text.data());
}

}  // namespace

struct SnapshotSigner::Key {
  std::shared_ptr<EVP_PKEY> key;
  std::string public_sha256;
};

SnapshotSigner::SnapshotSigner(std::unique_ptr<Key> key) : key_(std::move(key)) {}
SnapshotSigner::SnapshotSigner(SnapshotSigner&&) noexcept = default;
SnapshotSigner& SnapshotSigner::operator=(SnapshotSigner&&) noexcept = default;
SnapshotSigner::~SnapshotSigner() = default;

StatusOr<SnapshotSigner> SnapshotSigner::Read(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string pem,
                            ReadInputFile("signing key", path, kMaxKeyBytes));
  auto key = std::make_unique<Key>();
  key->key = PrivateKeyOfPem(pem);
  std::array<unsigned char, kPublicKeyBytes> raw = {};
  std::size_t size = raw.size();
  if (!key->key || EVP_PKEY_id(key->key.get()) != EVP_PKEY_ED25519 ||
      EVP_PKEY_get_raw_public_key(key->key.get(), raw.data(), &size) != 1) {
    return InvalidArgument("signing key '{}': expected an Ed25519 private key in PEM", path);
  }
  Sha256 hash;
  hash.Update({reinterpret_cast<const char*>(raw.data()), size});
  key->public_sha256 = hash.HexDigest();
  return SnapshotSigner(std::move(key));
}

const std::string& SnapshotSigner::key_sha256() const { return key_->public_sha256; }

SnapshotSignature SnapshotSigner::Sign(const SnapshotInfo& snapshot) const {
  const std::string text = SignedText(snapshot);
  const std::unique_ptr<EVP_MD_CTX, FreeDigest> digest(EVP_MD_CTX_new());
  std::string signature(kSignatureBytes, '\0');
  std::size_t size = signature.size();
  const bool made =
      digest && EVP_DigestSignInit(digest.get(), nullptr, nullptr, nullptr, key_->key.get()) == 1 &&
      EVP_DigestSign(digest.get(),
                     reinterpret_cast<unsigned char*>(signature.data()),
                     &size,
                     Bytes(text),
                     text.size()) == 1;
  SHIFTMAP_CHECK(made && size == kSignatureBytes, "a signature of {} bytes", size);
  return {key_->public_sha256, signature};
}

}  // namespace shiftmap::server
