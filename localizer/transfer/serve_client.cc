// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/serve_client.h"

#include "localizer/live/client.h"

namespace shiftmap::transfer {

Status EnableBetweenShifts(const std::string& socket, const FolderMap& map) {
  StatusOr<live::Client> client = live::Client::Connect(socket);
  if (!client.ok()) return Unavailable("{}", Message(client.status()));
  SHIFTMAP_ASSIGN_OR_RETURN(const live::Reply reply, client->Call(live::GetState()));
  if (reply.state && reply.state->running) {
    return Unavailable("socket '{}': a shift is under way", socket);
  }
  (void)map;
  return OkStatus();
}

}  // namespace shiftmap::transfer
