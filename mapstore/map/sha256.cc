// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/sha256.h"

#include <openssl/evp.h>

#include <array>
#include <fstream>

#include "mapstore/core/input_file.h"
#include "proto/core/check.h"

namespace shiftmap {

struct Sha256::State {
  EVP_MD_CTX* context = EVP_MD_CTX_new();
  State() { SHIFTMAP_CHECK(EVP_DigestInit_ex(context, EVP_sha256(), nullptr) == 1, "no SHA-256"); }
  ~State() { EVP_MD_CTX_free(context); }
  State(const State&) = delete;
  State& operator=(const State&) = delete;
};

Sha256::Sha256() : state_(std::make_unique<State>()) {}
Sha256::~Sha256() = default;
Sha256::Sha256(Sha256&&) noexcept = default;
Sha256& Sha256::operator=(Sha256&&) noexcept = default;

void Sha256::Update(std::string_view bytes) {
  SHIFTMAP_CHECK(EVP_DigestUpdate(state_->context, bytes.data(), bytes.size()) == 1,
                 "update failed");
}

std::string Sha256::HexDigest() {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int size = 0;
  SHIFTMAP_CHECK(EVP_DigestFinal_ex(state_->context, digest.data(), &size) == 1, "final failed");
  std::string hex;
  for (unsigned int i = 0; i < size; ++i) hex += fmt::format("{:02x}", digest[i]);
  return hex;
}

StatusOr<Sha256> BeginHash(const std::string& path) {
  StatusOr<std::ifstream> opened = OpenInputFile(path);
  SHIFTMAP_RETURN_IF_ERROR(Annotate(opened.status(), "file '{}'", path));
  std::ifstream& file = *opened;
  std::array<char, 1 << 16> buffer{};
  Sha256 hash;
  while (file.read(buffer.data(), buffer.size()) || file.gcount() > 0) {
    hash.Update({buffer.data(), static_cast<std::size_t>(file.gcount())});
  }
  if (!file.eof()) return Unavailable("file '{}': cannot be read", path);
  return hash;
}

StatusOr<std::string> HashFile(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(Sha256 hash, BeginHash(path));
  return hash.HexDigest();
}

}  // namespace shiftmap
