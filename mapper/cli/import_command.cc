// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "mapper/cli/commands.h"
#include "mapper/cli/map_file.h"
#include "mapper/mapper_options.h"
#include "mapstore/cli/input_options.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/cli/version.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/map/sha256.h"
#include "mapstore/map_store.h"

namespace shiftmap {
namespace {

struct ImportOptions {
  std::string store;
  std::string area;
  std::string survey;
  std::string format = MapFileFormats().front();
  std::optional<double> stamp_s;
  double leave_rate_per_s = ModeOptions().leave_rate_per_s;
  bool no_publish = false;
  double clock_tolerance_s = kDefaultClockToleranceS;
};

// The version that an import would replace.
StatusOr<std::optional<VersionNumber>> PublishedBefore(const ImportOptions& options,
                                                       const Context& context) {
  // Also in a dry run: what is there must be a store.
  std::error_code error;
  if (!std::filesystem::exists(options.store, error)) return std::optional<VersionNumber>();
  if (context.dry_run()) {
    SHIFTMAP_RETURN_IF_ERROR(MapStore::CheckWritable(options.store, true));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(options.store, MapStore::Access::kReadOnly, context));
  return store.PublishedVersion(options.area);
}

Status Import(const ImportOptions& options, Context& context) {
  const Stamp now = SystemNow();
  const auto check_clock = [&](Stamp stamp) {
    return CheckNotInFuture(
        fmt::format("survey '{}'", options.survey), stamp, now, options.clock_tolerance_s);
  };
  MapFileOptions file;
  file.format = options.format;
  if (options.stamp_s) {
    file.stamp = StampFromSeconds(*options.stamp_s);
    SHIFTMAP_RETURN_IF_ERROR(check_clock(*file.stamp));
  }
  file.now = now;
  file.leave_rate_per_s = options.leave_rate_per_s;
  SHIFTMAP_ASSIGN_OR_RETURN(const MapContent content, ReadMapFile(options.survey, file));
  SHIFTMAP_RETURN_IF_ERROR(check_clock(content.stamp));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string survey_hash, HashFile(options.survey));
  std::size_t modes = 0;
  for (const LandmarkGroup& group : content.groups) modes += group.modes.size();

  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<VersionNumber> before,
                            PublishedBefore(options, context));
  Json document = {{"area", options.area}};
  std::string text = fmt::format("{} landmarks, {} modes, probabilities of {} UTC",
                                 content.groups.size(),
                                 modes,
                                 FormatUtc(content.stamp));
  if (!context.dry_run()) {
    Provenance provenance;
    provenance.tool = "shiftmap-mapper " + SoftwareVersion();
    provenance.configuration = Json{
        {"revision", SoftwareRevision()},
        {"survey_sha256", survey_hash},
        {"leave_rate_per_s",
         options.leave_rate_per_s}}.dump();
    SHIFTMAP_ASSIGN_OR_RETURN(
        MapStore store,
        OpenStore(
            options.store, MapStore::Access::kReadWriteCreate, context, options.clock_tolerance_s));
    CommitOptions commit;
    commit.publish = !options.no_publish;
    SHIFTMAP_ASSIGN_OR_RETURN(const CommitResult result,
                              store.Commit(options.area, content, provenance, commit));
    document["version"] = result.version.value();
    document["content_hash"] = result.content_hash;
    text = fmt::format(
        "version {} of area '{}': {}", result.version.value(), InertLine(options.area), text);
    if (before && !options.no_publish) {
      context.Warn(fmt::format(
          "area '{}': these landmarks replace version {}, and do not add to it; shiftmap-inspect "
          "publish {} --expected {} takes that back",
          InertLine(options.area),
          before->value(),
          before->value(),
          result.version.value()));
    }
  }
  document["groups"] = content.groups.size();
  document["modes"] = modes;
  document["stamp_s"] = ToSecondsSinceEpoch(content.stamp);
  context.Report(document, text + "\n");
  return OkStatus();
}

}  // namespace

void AddImportCommand(Application* application) {
  auto options = std::make_shared<ImportOptions>();
  Command& command = application->AddCommand(
      "import", "Make a map version of surveyed landmarks", [options](Context& context) {
        return Import(*options, context);
      });
  AddClockToleranceOption(&options->clock_tolerance_s, &command);
  command.Option("--store", &options->store, "Map store; made if there is none").Required();
  command.Option("--area", &options->area, "Area to make a version of").Required();
  command
      .Option(
          "--stamp-s",
          &options->stamp_s,
          "When the probabilities hold, seconds since the epoch; default: as the file says, or now")
      .InRange(0.0, 9.2e9);
  command
      .Option("--leave-rate-per-s",
              &options->leave_rate_per_s,
              "Rate at which landmarks leave a mode, where the file gives none")
      .InRange(0.0, 1e3);
  command.Flag("--no-publish", &options->no_publish, "Add the version, but publish it later");
  command
      .Option("--format",
              &options->format,
              "auto: by the ending .geojson, .textproto, .protojson or .json, or else csv")
      .OneOf(MapFileFormats());
  command
      .Option("LANDMARKS",
              &options->survey,
              "CSV, signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability, or an export of a map")
      .Required();
  command.Writes();
}

}  // namespace shiftmap
