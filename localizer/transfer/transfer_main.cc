// SPDX-License-Identifier: Apache-2.0
//
// The commands of shiftmap-localizer that talk to the map server. That program hands over to this
// one, so that it does not link gRPC itself.
#include "localizer/transfer/cli/transfer_bodies.h"
#include "localizer/transfer/cli/transfer_commands.h"

int main(int argc, char** argv) {
  shiftmap::Application application("shiftmap-localizer",
                                    "Exchanges reports, logs and maps with the map server");
  application.LeaveSiteFileUnchecked();
  shiftmap::AddFetchCommand(&application, shiftmap::transfer::RunFetch);
  shiftmap::AddReturnCommand(&application, shiftmap::transfer::RunReturn);
  shiftmap::AddUploadCommand(&application, shiftmap::transfer::RunUpload);
  shiftmap::AddSyncCommand(&application, shiftmap::transfer::RunSync);
  return application.Main(argc, argv);
}
