// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "mapstore/server/calls.h"
#include "mapstore/server/limits.h"
#include "mapstore/server/revocations.h"
#include "proto/core/status.h"

namespace shiftmap::server {

/// The other end of a connection.
struct Peer {
  std::string address;      ///< As gRPC writes it: "ipv4:10.0.0.7:41234".
  std::string certificate;  ///< In PEM, verified; empty without TLS.
};

/// Decides on each call whether its caller may make it. Threads: any.
class AccessGate {
 public:
  /// @param revocations  Null: connections are plain text, for development, and every caller is an
  ///                     operator.
  AccessGate(std::unique_ptr<Revocations> revocations, double calls_per_s)
      : revocations_(std::move(revocations)), rate_(calls_per_s) {}

  /// Errors: kUnauthenticated if the certificate says nothing, is over or revoked.
  StatusOr<Caller> Identify(const Peer& peer) const;

  /// Errors: kPermissionDenied if the caller's role may not make the call; kResourceExhausted if he
  /// calls too often.
  Status Admit(const Caller& caller, Call call);

 private:
  const std::unique_ptr<Revocations> revocations_;
  RateLimit rate_;
};

}  // namespace shiftmap::server
