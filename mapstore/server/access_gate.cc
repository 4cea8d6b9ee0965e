// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/access_gate.h"

#include "mapstore/core/clock.h"

namespace shiftmap::server {

StatusOr<Caller> AccessGate::Identify(const Peer& peer) const {
  if (!revocations_) return Caller{"development", Role::kOperator, peer.address, peer.address};
  SHIFTMAP_ASSIGN_OR_RETURN(const ClientCertificate certificate,
                            ReadClientCertificate(peer.certificate));
  // A connection may be older than what is known of its certificate.
  const Stamp now = SystemNow();
  if (now < certificate.begin || now > certificate.end) {
    return MakeStatus(StatusCode::kUnauthenticated,
                      "client certificate of '{}': holds from {} to {}",
                      certificate.name,
                      FormatUtc(certificate.begin),
                      FormatUtc(certificate.end));
  }
  if (revocations_->IsRevoked(certificate)) {
    return MakeStatus(
        StatusCode::kUnauthenticated, "client certificate of '{}': revoked", certificate.name);
  }
  return Caller{certificate.name, certificate.role, peer.address, certificate.name};
}

Status AccessGate::Admit(const Caller& caller, Call call) {
  SHIFTMAP_RETURN_IF_ERROR(rate_.Take(caller.limit_key));
  if (MayCall(caller.role, call)) return OkStatus();
  return MakeStatus(StatusCode::kPermissionDenied,
                    "'{}' has the role {}, which may not call {}",
                    caller.name,
                    NameOf(caller.role),
                    NameOf(call));
}

}  // namespace shiftmap::server
