// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/map_html.h"
#include "tools/inspect/store_arguments.h"
#include "tools/view/map_document.h"
#include "tools/view/view_page.h"
#include "tools/view/view_server.h"

namespace shiftmap {
namespace {

struct ViewArguments {
  StoreArguments store;
  std::string listen = "127.0.0.1:0";
  bool any_address = false;
  std::optional<std::string> replay;
};

std::string CheckListen(const ViewArguments& arguments) {
  const StatusOr<ListenAddress> address = ParseListenAddress("--listen", arguments.listen);
  if (!address.ok()) return Message(address.status());
  if (!address->IsAddress()) {
    return fmt::format("--listen '{}': expected an IP address, not a name", arguments.listen);
  }
  if (address->IsLoopback() || arguments.any_address) return "";
  return fmt::format(
      "--listen '{}' lets other machines read the map, without a password and without encryption; "
      "--any-address allows it",
      arguments.listen);
}

Status RunView(const ViewArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const ListenAddress wanted,
                            ParseListenAddress("--listen", arguments.listen));
  const auto make_page = [&]() -> StatusOr<std::string> {
    SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
    return MapHtml(arguments.store, arguments.replay, &store);
  };
  // Fails before a browser asks if the store cannot be read.
  SHIFTMAP_RETURN_IF_ERROR(make_page().status());
  SHIFTMAP_ASSIGN_OR_RETURN(ViewServer server, ViewServer::Start(wanted, make_page));
  const std::string url = server.address().Url();
  context.Inform(fmt::format("area '{}' is at {} until SIGINT", arguments.store.area, url));
  server.WaitForSignal();
  context.Report({{"area", arguments.store.area}, {"url", url}}, "stopped\n");
  return OkStatus();
}

}  // namespace

StatusOr<std::string> MapHtml(const StoreArguments& arguments,
                              const std::optional<std::string>& replay,
                              MapStore* store) {
  SHIFTMAP_RETURN_IF_ERROR(CheckWebView());
  MapDocumentOptions options;
  if (arguments.version) options.version = VersionNumber(*arguments.version);
  if (arguments.at_s) options.at = StampFromSeconds(*arguments.at_s);
  if (arguments.known_s) options.known = StampFromSeconds(*arguments.known_s);
  options.replay = replay;
  SHIFTMAP_ASSIGN_OR_RETURN(const Json document, MapDocument(arguments.area, options, store));
  return ViewPage(document);
}

void AddViewCommands(Application* application) {
  auto arguments = std::make_shared<ViewArguments>();
  Command& command = application->AddCommand(
      "view",
      "Show a map in a web browser: landmarks over time, their visits, versions side by side. "
      "Reads the store only",
      [arguments](Context& context) { return RunView(*arguments, context); });
  AddMapOptions(&arguments->store, &command);
  AddKnownOption(&arguments->store, &command);
  command
      .Option("--listen",
              &arguments->listen,
              "ADDRESS:PORT to serve the page at; port 0: one that is free")
      .Flag("--any-address",
            &arguments->any_address,
            "Allow addresses that other machines reach: they read without a password")
      .Option("--replay",
              &arguments->replay,
              "A shift to replay: a recording of shiftmap-localizer run")
      .Check([arguments] { return CheckListen(*arguments); });
}

}  // namespace shiftmap
