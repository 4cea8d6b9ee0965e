// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "localizer/transfer/cli/transfer_commands.h"
#include "localizer/transfer/server_options.h"
#include "mapstore/cli/context.h"
#include "proto/core/status.h"

namespace shiftmap::transfer {

Status RunFetch(const FetchArguments& arguments, Context& context);
Status RunReturn(const ReturnArguments& arguments, Context& context);
Status RunUpload(const UploadArguments& arguments, Context& context);
Status RunSync(const SyncArguments& arguments, Context& context);

/// The client's options of a command's arguments.
ServerOptions ServerOptionsOf(const ServerArguments& arguments);

}  // namespace shiftmap::transfer
