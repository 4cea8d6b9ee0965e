// SPDX-License-Identifier: Apache-2.0
//
// The commands of shiftmap-localizer that talk to the map server. That program hands over to this
// one, under its own name, so that it does not link gRPC itself.
#include <string_view>

#include "localizer/transfer/cli/transfer_bodies.h"
#include "localizer/transfer/cli/transfer_commands.h"

int main(int argc, char** argv) {
  const bool handed_over = argc > 0 && std::string_view(argv[0]) == "shiftmap-localizer";
  shiftmap::Application application(handed_over ? "shiftmap-localizer" : "shiftmap-transfer",
                                    "Exchanges reports, logs and maps with the map server");
  application.ReadSiteFileOf("localizer");
  shiftmap::AddFetchCommand(&application, shiftmap::transfer::RunFetch);
  shiftmap::AddReturnCommand(&application, shiftmap::transfer::RunReturn);
  shiftmap::AddUploadCommand(&application, shiftmap::transfer::RunUpload);
  shiftmap::AddSyncCommand(&application, shiftmap::transfer::RunSync);
  return application.Main(argc, argv);
}
