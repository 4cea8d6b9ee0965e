// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "mapstore/cli/store_access.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/map/map_diff.h"
#include "tools/inspect/diff_text.h"
#include "tools/inspect/edit_text.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/store_arguments.h"

namespace shiftmap {
namespace {

struct DiffArguments {
  StoreArguments store;
  std::int64_t from = 0;
  std::int64_t to = 0;
  double min_move_sigma = 0.0;
  bool all = false;
};

struct PublishArguments {
  StoreArguments store;
  std::int64_t version = 0;
  std::optional<std::int64_t> expected;
};

struct RollbackArguments {
  StoreArguments store;
  std::optional<std::int64_t> to;
};

Json NumbersJson(const std::vector<ModeNumber>& numbers) {
  Json list = Json::array();
  for (const ModeNumber number : numbers) list.push_back(number.value());
  return list;
}

Json SignaturesJson(const std::vector<Signature>& signatures) {
  Json list = Json::array();
  for (const Signature& signature : signatures) list.push_back(signature.text());
  return list;
}

Json GroupJson(const GroupDiff& group) {
  Json merged = Json::array();
  for (const MergedMode& mode : group.merged) {
    merged.push_back({{"mode", mode.number.value()}, {"into", mode.into.value()}});
  }
  Json moved = Json::array();
  for (const MovedMode& mode : group.moved) {
    moved.push_back({{"mode", mode.number.value()},
                     {"dx_m", mode.displacement_m.x()},
                     {"dy_m", mode.displacement_m.y()},
                     {"distance_m", mode.displacement_m.norm()},
                     {"mahalanobis", std::sqrt(mode.squared_mahalanobis)},
                     {"p_value", mode.p_value}});
  }
  Json json = {{"signature", group.signature.text()},
               {"modes_added", NumbersJson(group.added)},
               {"modes_removed", NumbersJson(group.removed)},
               {"modes_merged", merged},
               {"modes_moved", moved},
               {"uncertainty_changed", group.uncertainty_changed},
               {"probability_change", group.probability_change}};
  if (group.rates_changed) {
    json["move_rate_per_s"] = {{"from", group.from_move_rate_per_s},
                               {"to", group.to_move_rate_per_s}};
  }
  return json;
}

Json DiffJson(const DiffArguments& arguments, const MapDiff& diff) {
  Json groups = Json::array();
  for (const GroupDiff& group : diff.groups) groups.push_back(GroupJson(group));
  Json calibration = Json::array();
  for (const CalibrationChange& change : diff.calibration) {
    calibration.push_back({{"vehicle", change.vehicle},
                           {"name", change.name},
                           {"from", change.from},
                           {"to", change.to}});
  }
  return {{"area", arguments.store.area},
          {"from", arguments.from},
          {"to", arguments.to},
          {"groups_added", SignaturesJson(diff.groups_added)},
          {"groups_removed", SignaturesJson(diff.groups_removed)},
          {"groups", groups},
          {"anonymous_landmarks",
           {{"from", diff.anonymous_from},
            {"to", diff.anonymous_to},
            {"changed", diff.anonymous_changed}}},
          {"vehicles_added", diff.vehicles_added},
          {"vehicles_removed", diff.vehicles_removed},
          {"calibration", calibration}};
}

// Of the second map, from the visits that tell of it; only if a rate changed.
StatusOr<MoveRates> RatesOf(const MapSnapshot& to, const MapDiff& diff, MapStore* store) {
  const bool changed = std::any_of(diff.groups.begin(), diff.groups.end(), [](const auto& group) {
    return group.rates_changed;
  });
  if (!changed) return MoveRates();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<EvidenceRow> rows,
                            store->Evidence(to.area(), to.version()));
  return EstimateMoveRates(to, rows);
}

// Edits that the second version is made with and the first is not, and the other way.
struct EditChanges {
  std::vector<MapEdit> made;
  std::vector<MapEdit> taken_back;
};

// What is no change of a landmark: names, and the frame.
void AddCarried(const EarlierMap& from, Json* document) {
  Json renamed = Json::array();
  for (const auto& [before, after] : from.renamed) {
    renamed.push_back({{"from", before.text()}, {"to", after.text()}});
  }
  (*document)["renamed"] = std::move(renamed);
  (*document)["frame_moved"] = nullptr;
  if (!from.moved) return;
  (*document)["frame_moved"] = {
      {"x_m", from.moved->x()}, {"y_m", from.moved->y()}, {"yaw_rad", from.moved->yaw()}};
}

StatusOr<EditChanges> EditChangesOf(const DiffArguments& arguments, MapStore* store) {
  const std::string& area = arguments.store.area;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> from,
                            store->EditsOf(area, VersionNumber(arguments.from)));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> to,
                            store->EditsOf(area, VersionNumber(arguments.to)));
  const auto without = [](const std::vector<MapEdit>& edits, const std::vector<MapEdit>& others) {
    std::vector<MapEdit> left;
    for (const MapEdit& edit : edits) {
      const bool common = std::any_of(
          others.begin(), others.end(), [&](const MapEdit& other) { return other.id == edit.id; });
      if (!common) left.push_back(edit);
    }
    return left;
  };
  return EditChanges{without(to, from), without(from, to)};
}

Json EditsJson(const std::vector<MapEdit>& edits) {
  Json list = Json::array();
  for (const MapEdit& edit : edits) list.push_back(EditJson(edit));
  return list;
}

std::string EditsText(const EditChanges& edits) {
  std::string text;
  for (const MapEdit& edit : edits.made) text += EditLine(edit);
  for (const MapEdit& edit : edits.taken_back) text += "no longer: " + EditLine(edit);
  return text.empty() ? text : text + "\n";
}

Status RunDiff(const DiffArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store, context));
  const std::string& area = arguments.store.area;
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot to,
                            LoadAsBuilt(area, VersionNumber(arguments.to), &store));
  SHIFTMAP_ASSIGN_OR_RETURN(const EarlierMap from,
                            LoadEarlier(VersionNumber(arguments.from), to, &store));
  MapDiff diff = DiffMaps(from.map.content(), to.content());
  for (GroupDiff& group : diff.groups) {
    std::erase_if(group.moved, [&](const MovedMode& mode) {
      return std::sqrt(mode.squared_mahalanobis) < arguments.min_move_sigma;
    });
  }
  std::erase_if(diff.groups, [](const GroupDiff& group) { return group.empty(); });
  SHIFTMAP_ASSIGN_OR_RETURN(const EditChanges edits, EditChangesOf(arguments, &store));
  if (context.json()) {
    Json document = DiffJson(arguments, diff);
    AddCarried(from, &document);
    document["edits_made"] = EditsJson(edits.made);
    document["edits_taken_back"] = EditsJson(edits.taken_back);
    context.Report(document, "");
    return OkStatus();
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const MoveRates rates, RatesOf(to, diff, &store));
  context.Report(
      {}, EditsText(edits) + DiffText(from, to, diff, rates, arguments.all, context.style()));
  return OkStatus();
}

void ReportPublished(const std::string& area, VersionNumber version, Context& context) {
  context.Report({{"area", area}, {"published", version.value()}},
                 fmt::format("area '{}': version {} {}\n",
                             InertLine(area),
                             version.value(),
                             context.dry_run() ? "would be published" : "is published"));
}

// The version that must be published now: as asked for, or the parent of the one to publish.
StatusOr<std::optional<VersionNumber>> ExpectedVersion(const PublishArguments& arguments,
                                                       MapStore* store) {
  if (arguments.expected) {
    // 0 stands for none.
    if (*arguments.expected == 0) return std::optional<VersionNumber>();
    return std::optional(VersionNumber(*arguments.expected));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions,
                            store->Versions(arguments.store.area));
  for (const VersionSummary& version : versions) {
    if (version.version.value() == arguments.version) return version.parent;
  }
  return NotFound("map store '{}': area '{}': no version {}",
                  arguments.store.store,
                  arguments.store.area,
                  arguments.version);
}

Status RunPublish(const PublishArguments& arguments, Context& context) {
  const auto access =
      context.dry_run() ? MapStore::Access::kReadOnly : MapStore::Access::kReadWrite;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store.store, access, context));
  const VersionNumber version(arguments.version);
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<VersionNumber> expected,
                            ExpectedVersion(arguments, &store));
  SHIFTMAP_RETURN_IF_ERROR(
      store.Publish(arguments.store.area, version, expected, context.dry_run()));
  ReportPublished(arguments.store.area, version, context);
  return OkStatus();
}

Status RunRollback(const RollbackArguments& arguments, Context& context) {
  const auto access =
      context.dry_run() ? MapStore::Access::kReadOnly : MapStore::Access::kReadWrite;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments.store.store, access, context));
  std::optional<VersionNumber> to;
  if (arguments.to) to = VersionNumber(*arguments.to);
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionNumber published,
                            store.Rollback(arguments.store.area, to, context.dry_run()));
  ReportPublished(arguments.store.area, published, context);
  return OkStatus();
}

}  // namespace

void AddVersionCommands(Application* application) {
  auto diff = std::make_shared<DiffArguments>();
  Command& diff_command = application->AddCommand(
      "diff",
      "Show what changed from one map version to another, what matters first",
      [diff](Context& context) { return RunDiff(*diff, context); });
  AddStoreOptions(&diff->store, &diff_command);
  diff_command.Option("FROM", &diff->from, "Map version").Required();
  diff_command.Option("TO", &diff->to, "Map version").Required();
  diff_command
      .Option(
          "--min-move-sigma", &diff->min_move_sigma, "Leave out moves of fewer standard deviations")
      .InRange(0.0, 1e9)
      .Flag("--all", &diff->all, "Every change in full, small ones too")
      .Watchable();

  auto publish = std::make_shared<PublishArguments>();
  Command& publish_command = application->AddCommand(
      "publish",
      "Make a map version the one that vehicles get, if its parent is published now",
      [publish](Context& context) { return RunPublish(*publish, context); });
  AddStoreOptions(&publish->store, &publish_command);
  publish_command.Option("VERSION", &publish->version, "Map version").Required();
  publish_command.Option("--expected",
                         &publish->expected,
                         "Version that must be published now instead of the parent; 0: none");
  publish_command.Writes();

  auto rollback = std::make_shared<RollbackArguments>();
  Command& rollback_command = application->AddCommand(
      "rollback",
      "Publish the parent of the published version again, or another ancestor",
      [rollback](Context& context) { return RunRollback(*rollback, context); });
  AddStoreOptions(&rollback->store, &rollback_command);
  rollback_command.Option("VERSION", &rollback->to, "Ancestor to go back to (default: the parent)");
  rollback_command.Writes();
}

}  // namespace shiftmap
