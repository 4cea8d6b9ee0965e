// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/serve_client.h"

#include "localizer/live/client.h"

namespace shiftmap::transfer {
namespace {

Status Enable(live::Client* client, const FolderMap& map) {
  SHIFTMAP_ASSIGN_OR_RETURN(const live::Reply state, client->Call(live::GetState()));
  if (state.state && state.state->running) return Unavailable("a shift is under way");
  live::Subscribe owner{};
  owner.map_owner = true;
  SHIFTMAP_RETURN_IF_ERROR(client->Call(owner).status());
  live::EnableMap enable;
  enable.map_id = map.map_id;
  enable.map_version = map.map_version;
  return client->Call(enable).status();
}

}  // namespace

Status EnableBetweenShifts(const std::string& socket, const FolderMap& map) {
  StatusOr<live::Client> client = live::Client::Connect(socket);
  SHIFTMAP_RETURN_IF_ERROR(client.status());
  return Annotate(Enable(&*client, map), "socket '{}'", socket);
}

}  // namespace shiftmap::transfer
