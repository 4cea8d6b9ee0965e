// SPDX-License-Identifier: Apache-2.0
//
// Inside server/ only: it is for gRPC's types.
#pragma once

#include <grpcpp/security/server_credentials.h>

#include <memory>

#include "mapstore/server/map_server.h"
#include "proto/core/status.h"

namespace shiftmap::server {

/// Mutual TLS: a client without a certificate of the authority does not get past the handshake.
/// Certificates, key and authority are read again within a minute of a change.
/// Errors: kNotFound, kInvalidArgument if the files do not read or key and certificate do not fit.
StatusOr<std::shared_ptr<grpc::ServerCredentials>> TlsCredentials(const TlsFiles& files);

}  // namespace shiftmap::server
