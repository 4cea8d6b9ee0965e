// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "proto/core/status.h"

namespace shiftmap {

/// Incremental SHA-256 (OpenSSL).
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;

  void Update(std::string_view bytes);

  /// The digest as 64 lower-case hex digits. Call once.
  std::string HexDigest();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// SHA-256 of a file in hex.
/// Errors: kNotFound if it does not exist; kUnavailable if it cannot be read.
StatusOr<std::string> HashFile(const std::string& path);

/// The hash of a file's bytes, to go on with others. Errors as HashFile().
StatusOr<Sha256> BeginHash(const std::string& path);

}  // namespace shiftmap
