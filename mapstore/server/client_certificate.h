// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <openssl/types.h>

#include <memory>
#include <string>

#include "mapstore/core/stamp.h"
#include "mapstore/server/calls.h"
#include "proto/core/status.h"

namespace shiftmap::server {

/// Who a client is by its certificate, whose signature the handshake has checked.
struct ClientCertificate {
  std::string name;            ///< CN.
  Role role = Role::kVehicle;  ///< OU.
  Stamp begin;                 ///< First and last time at which it holds.
  Stamp end;
  std::shared_ptr<X509> x509;
};

/// @param pem  The first certificate in it counts.
/// Errors: kUnauthenticated if it is no certificate with one CN and one OU that is a role.
StatusOr<ClientCertificate> ReadClientCertificate(const std::string& pem);

}  // namespace shiftmap::server
