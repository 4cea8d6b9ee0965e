// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <openssl/types.h>

#include <chrono>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "mapstore/server/client_certificate.h"
#include "mapstore/server/json_log.h"
#include "proto/core/status.h"

namespace shiftmap::server {

/// The certificates that their authority revoked: a file of CRLs (RFC 5280) in PEM, which is read
/// again when it changes. One that no longer reads, or that no authority of the site signed, leaves
/// what was read before, and is logged; so is one whose time is over. Threads: any.
class Revocations {
 public:
  /// @param crl_path        The CRLs; empty: nothing is revoked.
  /// @param authority_path  The authorities' certificates in PEM; one of them signed each CRL.
  /// @param log             Must outlive this.
  /// Errors: kNotFound, kInvalidArgument. Messages start with `CRL 'PATH': `.
  static StatusOr<std::unique_ptr<Revocations>> Read(const std::string& crl_path,
                                                     const std::string& authority_path,
                                                     JsonLog* log);

  /// Whether a certificate is revoked, by the file as it was at most a second ago.
  bool IsRevoked(const ClientCertificate& certificate);

 private:
  using Clock = std::chrono::steady_clock;
  using Lists = std::vector<std::shared_ptr<X509_CRL>>;

  Revocations(std::string crl_path, std::string authority_path, JsonLog* log)
      : crl_path_(std::move(crl_path)), authority_path_(std::move(authority_path)), log_(log) {}

  StatusOr<Lists> Load() const;
  void WarnOfOld();
  void ReloadIfChanged();

  const std::string crl_path_;
  const std::string authority_path_;
  JsonLog* const log_;
  std::mutex mutex_;
  Lists lists_;
  std::set<const X509_CRL*> warned_of_;
  std::string state_;  // Of the file: when and what was last read.
  Clock::time_point looked_{};
};

}  // namespace shiftmap::server
