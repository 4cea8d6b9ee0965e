// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "localizer/maps/map_folder.h"
#include "localizer/transfer/backoff.h"
#include "localizer/transfer/map_download.h"
#include "localizer/transfer/sync_service.h"

namespace shiftmap::transfer {

struct DownloadWorkerOptions {
  std::string socket;  ///< Of `serve`.
  std::string maps;    ///< Its folder of maps.
  MapFolderOptions folder;
  MapDownloadOptions download;

  /// Of one download: it fails after give_up_s without a byte.
  BackoffOptions backoff;

  std::function<void(const std::string&)> warn;
  std::function<void(const std::string&)> inform;
};

/// Does the downloads that fleet control has `serve` order: puts each file into the folder of maps,
/// verified, and tells `serve` what became of it. A download that was cut goes on from the bytes
/// that came, also in another process.
Workers::Worker DownloadWorker(DownloadWorkerOptions options);

/// The same of one download, with its retries.
/// Errors: as DownloadMapFile; as MapFolder::Add.
Status DownloadIntoFolder(const DownloadWorkerOptions& options,
                          const std::string& link,
                          const ExpectedMap& expected,
                          const std::stop_token& stop);

}  // namespace shiftmap::transfer
