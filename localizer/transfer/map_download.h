// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <stop_token>
#include <string>

#include "proto/core/status.h"

namespace shiftmap::transfer {

struct MapDownloadOptions {
  std::string ca;                                  ///< PEM file; empty: the system's authorities.
  std::int64_t max_bytes = std::int64_t{1} << 30;  ///< Of a file, > 0. [byte]
  double max_bytes_per_s = 0.0;                    ///< 0: as fast as it comes. [B/s]
  double silent_s = 30.0;  ///< A connection on which nothing came for so long is given up, > 0. [s]

  std::function<void()> alive;  ///< Called while the file comes.
};

/// Downloads a file by HTTPS, one try. Bytes that are at `path` are its begin and are not asked for
/// again; what came stays there after an error. The caller verifies the hash.
///
/// The server's certificate is verified. Only https is followed, also where a server redirects.
///
/// Errors: kUnavailable for a network, server or disk that may do it later, and if `stop` was
/// requested; kOutOfRange if the server cannot go on from the bytes at `path`; kNotFound for 404
/// and 410; kPermissionDenied for 401, 403 and a certificate that nobody vouches for;
/// kInvalidArgument for another scheme, a file above the limit, and other answers. Messages start
/// with `link 'LINK': `.
Status DownloadMapFile(const std::string& link,
                       const std::string& path,
                       const MapDownloadOptions& options,
                       const std::stop_token& stop);

}  // namespace shiftmap::transfer
