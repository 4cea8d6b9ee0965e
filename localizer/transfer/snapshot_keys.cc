// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/snapshot_keys.h"

#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/pem.h>

#include <memory>
#include <utility>

#include "mapstore/core/input_file.h"
#include "mapstore/map/sha256.h"

namespace shiftmap::transfer {
namespace {

constexpr std::size_t kMaxPemBytes = std::size_t{64} << 10;
constexpr std::size_t kKeyBytes = 32;

struct FreeOpenSsl {
  void operator()(BIO* bio) const { BIO_free(bio); }
  void operator()(EVP_PKEY* key) const { EVP_PKEY_free(key); }
  void operator()(EVP_MD_CTX* context) const { EVP_MD_CTX_free(context); }
};

const unsigned char* Bytes(const std::string& text) {
  return reinterpret_cast<const unsigned char*>(text.data());
}

StatusOr<std::string> ReadKey(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string pem,
                            ReadInputFile("snapshot key", path, kMaxPemBytes));
  const std::unique_ptr<BIO, FreeOpenSsl> bio(
      BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())));
  const std::unique_ptr<EVP_PKEY, FreeOpenSsl> key(
      PEM_read_bio_PUBKEY(bio.get(), nullptr, nullptr, nullptr));
  std::string bytes(kKeyBytes, '\0');
  std::size_t size = bytes.size();
  if (key == nullptr || EVP_PKEY_id(key.get()) != EVP_PKEY_ED25519 ||
      EVP_PKEY_get_raw_public_key(
          key.get(), reinterpret_cast<unsigned char*>(bytes.data()), &size) != 1) {
    return InvalidArgument("snapshot key '{}': no Ed25519 public key in PEM", path);
  }
  return bytes;
}

bool IsSignature(const std::string& key_bytes,
                 const std::string& text,
                 const std::string& signature) {
  const std::unique_ptr<EVP_PKEY, FreeOpenSsl> key(
      EVP_PKEY_new_raw_public_key(EVP_PKEY_ED25519, nullptr, Bytes(key_bytes), key_bytes.size()));
  const std::unique_ptr<EVP_MD_CTX, FreeOpenSsl> context(EVP_MD_CTX_new());
  return key != nullptr && context != nullptr &&
         EVP_DigestVerifyInit(context.get(), nullptr, nullptr, nullptr, key.get()) == 1 &&
         EVP_DigestVerify(
             context.get(), Bytes(signature), signature.size(), Bytes(text), text.size()) == 1;
}

}  // namespace

StatusOr<SnapshotKeys> SnapshotKeys::Read(const std::vector<std::string>& paths) {
  SnapshotKeys keys;
  for (const std::string& path : paths) {
    SHIFTMAP_ASSIGN_OR_RETURN(std::string key, ReadKey(path));
    Sha256 hash;
    hash.Update(key);
    keys.keys_[hash.HexDigest()] = std::move(key);
  }
  return keys;
}

Status SnapshotKeys::Verify(const SnapshotInfo& snapshot) const {
  if (keys_.empty()) return OkStatus();
  const std::string text = SignedText(snapshot);
  bool known = false;
  for (const SnapshotSignature& signature : snapshot.signatures) {
    const auto key = keys_.find(signature.key_sha256);
    if (key == keys_.end()) continue;
    if (IsSignature(key->second, text, signature.signature)) return OkStatus();
    known = true;
  }
  return DataLoss("snapshot {}: {}",
                  snapshot.sha256,
                  known                         ? "its signature is wrong"
                  : snapshot.signatures.empty() ? "it is not signed"
                                                : "it is signed by other keys");
}

}  // namespace shiftmap::transfer
