// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/night_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <utility>

#include "mapper/nightly/night_json.h"
#include "mapper/nightly/refused_versions.h"
#include "mapper/nightly/take_over.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/core/atomic_file.h"
#include "mapstore/core/folder.h"
#include "mapstore/core/utf8.h"
#include "mapstore/maintenance/backup.h"
#include "mapstore/prior_version.h"

namespace shiftmap {
namespace {

namespace fs = std::filesystem;

constexpr int kFormat = 1;

std::string StoreCopy(const std::string& path) { return path + ".store.db"; }
std::string ResultStore(const std::string& path, std::size_t index) {
  return fmt::format("{}.{}.db", path, index);
}
std::string ResultDocument(const std::string& path, std::size_t index) {
  return fmt::format("{}.{}.json", path, index);
}

// The file at the path is whole, or not there.
Status CopyFile(const std::string& from, const std::string& to) {
  const std::string temporary = to + ".part";
  std::error_code error;
  fs::copy_file(from, temporary, fs::copy_options::overwrite_existing, error);
  if (error) return Unavailable("file '{}': cannot be copied: {}", from, error.message());
  return SyncAndRename(temporary, to);
}

bool Exists(const std::string& path) {
  std::error_code error;
  return fs::exists(path, error);
}

// The lists of AreaLogs by their names in a plan.
std::vector<std::pair<const char*, std::vector<LogHead> AreaLogs::*>> LogKinds() {
  return {{"fresh", &AreaLogs::fresh},
          {"waiting", &AreaLogs::waiting},
          {"again", &AreaLogs::again},
          {"mapped", &AreaLogs::mapped},
          {"excluded", &AreaLogs::excluded}};
}

Json LogJson(const LogHead& log) {
  return {{"path", log.path},
          {"vehicle", log.info.vehicle},
          {"uuid", log.info.uuid},
          {"begin_ns", ToNanoseconds(log.begin)},
          {"sha256", log.sha256}};
}

Json PlanJson(const NightPlan& plan) {
  Json areas = Json::array();
  for (const NightPlan::Area& area : plan.areas) {
    Json logs = Json::object();
    for (const auto& [name, kind] : LogKinds()) {
      logs[name] = Json::array();
      for (const LogHead& log : area.logs.*kind) logs[name].push_back(LogJson(log));
    }
    areas.push_back(
        {{"area", area.area},
         {"published", area.base.published ? Json(area.base.published->value()) : Json(nullptr)},
         {"newest", area.base.newest.value()},
         {"audit", area.base.audit},
         {"held", area.logs.held},
         {"logs", logs}});
  }
  return {{"plan", kFormat},
          {"store", plan.store},
          {"has_store", plan.has_store},
          {"logs", plan.logs},
          {"reports", {{"new", plan.reports_new}, {"known", plan.reports_known}}},
          {"left", plan.left},
          {"ignored", plan.ignored},
          {"areas", areas}};
}

LogHead LogFrom(const Json& document, const std::string& area) {
  LogHead log;
  log.path = document.at("path").get<std::string>();
  log.info.vehicle = document.at("vehicle").get<std::string>();
  log.info.uuid = document.at("uuid").get<std::string>();
  log.info.area = area;
  log.begin = StampFromNanoseconds(document.at("begin_ns").get<std::int64_t>());
  log.sha256 = document.at("sha256").get<std::string>();
  return log;
}

NightPlan PlanFrom(const Json& document) {
  NightPlan plan;
  plan.store = document.at("store").get<std::string>();
  plan.has_store = document.at("has_store").get<bool>();
  plan.logs = document.at("logs").get<std::string>();
  plan.reports_new = document.at("reports").at("new").get<int>();
  plan.reports_known = document.at("reports").at("known").get<int>();
  plan.left = document.at("left").get<std::vector<std::string>>();
  plan.ignored = document.at("ignored").get<std::vector<std::string>>();
  for (const Json& of_area : document.at("areas")) {
    NightPlan::Area area;
    area.area = of_area.at("area").get<std::string>();
    if (!of_area.at("published").is_null()) {
      area.base.published = VersionNumber(of_area.at("published").get<std::int64_t>());
    }
    area.base.newest = VersionNumber(of_area.at("newest").get<std::int64_t>());
    area.base.audit = of_area.at("audit").get<std::size_t>();
    area.logs.held = of_area.at("held").get<std::vector<std::string>>();
    for (const auto& [name, kind] : LogKinds()) {
      for (const Json& log : of_area.at("logs").at(name)) {
        (area.logs.*kind).push_back(LogFrom(log, area.area));
      }
    }
    plan.areas.push_back(std::move(area));
  }
  return plan;
}

// The document could not hold other bytes.
void LeaveOutOddNames(AreaLogs* logs, std::vector<std::string>* left) {
  for (const auto& [name, kind] : LogKinds()) {
    std::erase_if(logs->*kind, [&](const LogHead& log) {
      if (IsUtf8(log.path) && IsUtf8(log.info.vehicle) && IsUtf8(log.info.uuid)) return false;
      left->push_back(fmt::format("run log '{}' is left out: a name in it is not UTF-8", log.path));
      return true;
    });
  }
}

// The edits that are in force become a version now, so that every copy has it by the same number.
Status MakeEditsVersion(const NightOptions& options,
                        const std::string& area,
                        const Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      MapStore store,
      OpenStore(options.build.store,
                context.dry_run() ? MapStore::Access::kReadOnly : MapStore::Access::kReadWrite,
                context,
                options.build.clock_tolerance_s));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto published, store.PublishedVersion(area));
  if (!published || context.dry_run()) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> edits, store.Edits(area));
  if (edits.empty()) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const auto prior, FindPriorVersion(area, *published, nullptr, &store));
  if (!prior) return OkStatus();
  return store.WithEditsInForce(area, *prior).status();
}

StatusOr<AreaBase> ReadBase(const std::string& area, MapStore* store) {
  AreaBase base;
  const StatusOr<std::vector<VersionSummary>> versions = store->Versions(area);
  if (versions.status().code() == StatusCode::kNotFound) return base;
  if (!versions.ok()) return versions.status();
  if (!versions->empty()) base.newest = versions->back().version;
  SHIFTMAP_ASSIGN_OR_RETURN(base.published, store->PublishedVersion(area));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AuditEntry> audit, store->AuditLog(area));
  base.audit = audit.size();
  return base;
}

StatusOr<Json> ReadDocument(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return NotFound("file '{}': cannot be read", path);
  std::ostringstream text;
  text << file.rdbuf();
  Json document = Json::parse(text.str(), nullptr, false);
  if (!document.is_object()) return InvalidArgument("file '{}': is no JSON document", path);
  return document;
}

Status Collect(const NightPlan& plan,
               const std::string& path,
               std::size_t index,
               const Context& context) {
  if (!Exists(ResultStore(path, index))) return OkStatus();  // It made no store.
  const std::string folder = fs::path(fs::absolute(plan.store)).parent_path().string();
  SHIFTMAP_ASSIGN_OR_RETURN(const ScratchFolder scratch, ScratchFolder::Make(folder));
  const std::string copy = scratch.path() + "/result.db";
  SHIFTMAP_RETURN_IF_ERROR(CopyFile(ResultStore(path, index), copy));
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore from, OpenStore(copy, MapStore::Access::kReadOnly, context));
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore to,
                            OpenStore(plan.store, MapStore::Access::kReadWriteCreate, context));
  const NightPlan::Area& area = plan.areas[index];
  SHIFTMAP_RETURN_IF_ERROR(TakeOver(area.area, area.base, &from, &to));
  return CompactRefused(area.area, plan.store, context);
}

}  // namespace

StatusOr<NightPlan> PlanNight(const NightOptions& options,
                              const std::string& path,
                              Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(NightWork work, FindWork(options, context));
  NightPlan plan;
  plan.store = fs::absolute(options.build.store).string();
  plan.has_store = Exists(options.build.store);
  plan.logs = fs::absolute(options.logs).string();
  plan.reports_new = work.reports_new;
  plan.reports_known = work.reports_known;
  plan.left = std::move(work.left);
  for (const std::string& log : work.ignored) plan.ignored.push_back(fs::absolute(log).string());
  for (auto& [area, logs] : work.areas) {
    if (!IsUtf8(area)) {
      plan.left.push_back(fmt::format("area '{}' is left out: its name is not UTF-8", area));
      continue;
    }
    LeaveOutOddNames(&logs, &plan.left);
    for (const auto& [name, kind] : LogKinds()) {
      for (LogHead& log : logs.*kind) log.path = fs::absolute(log.path).string();
    }
    NightPlan::Area planned{area, {}, std::move(logs)};
    if (plan.has_store) {
      SHIFTMAP_RETURN_IF_ERROR(MakeEditsVersion(options, area, context));
      SHIFTMAP_ASSIGN_OR_RETURN(
          MapStore store, OpenStore(options.build.store, MapStore::Access::kReadOnly, context));
      SHIFTMAP_ASSIGN_OR_RETURN(planned.base, ReadBase(area, &store));
    }
    plan.areas.push_back(std::move(planned));
  }
  if (context.dry_run()) return plan;
  // Results of an older plan of that name are none of this one.
  for (std::size_t i = 0; Exists(ResultDocument(path, i)) || i < plan.areas.size(); ++i) {
    std::error_code error;
    fs::remove(ResultDocument(path, i), error);
    fs::remove(ResultStore(path, i), error);
  }
  if (plan.has_store) {
    SHIFTMAP_ASSIGN_OR_RETURN(const ScratchFolder scratch,
                              ScratchFolder::Make(fs::path(plan.store).parent_path().string()));
    const std::string copy = scratch.path() + "/store.db";
    SHIFTMAP_RETURN_IF_ERROR(BackupStore(options.build.store, copy).status());
    SHIFTMAP_RETURN_IF_ERROR(CopyFile(copy, StoreCopy(path)));
  }
  SHIFTMAP_RETURN_IF_ERROR(WriteFileAtomically(path, JsonText(PlanJson(plan))));
  return plan;
}

StatusOr<NightPlan> ReadPlan(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Json document, ReadDocument(path));
  try {
    if (document.at("plan").get<int>() != kFormat) {
      return FailedPrecondition(
          "plan '{}': format {}, this build reads {}", path, document.at("plan").dump(), kFormat);
    }
    return PlanFrom(document);
  } catch (const Json::exception& error) {
    return InvalidArgument("plan '{}': {}", path, error.what());
  }
}

StatusOr<AreaNight> RunPlanned(NightOptions options,
                               const std::string& path,
                               std::int64_t index,
                               const std::string& scratch,
                               Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const NightPlan plan, ReadPlan(path));
  const auto at = static_cast<std::size_t>(index);
  if (index < 0 || at >= plan.areas.size()) {
    return NotFound("plan '{}': no area {}, it has {}", path, index, plan.areas.size());
  }
  const NightPlan::Area& area = plan.areas[at];
  SHIFTMAP_ASSIGN_OR_RETURN(const ScratchFolder folder, ScratchFolder::Make(scratch));
  options.build.store = folder.path() + "/store.db";
  if (plan.has_store) SHIFTMAP_RETURN_IF_ERROR(CopyFile(StoreCopy(path), options.build.store));
  SHIFTMAP_ASSIGN_OR_RETURN(AreaNight night, RunArea(options, area.area, area.logs, context));
  if (context.dry_run()) return night;
  if (Exists(options.build.store)) {
    SHIFTMAP_RETURN_IF_ERROR(CopyFile(options.build.store, ResultStore(path, at)));
  }
  SHIFTMAP_RETURN_IF_ERROR(
      WriteFileAtomically(ResultDocument(path, at), JsonText(AreaNightJson(night))));
  return night;
}

StatusOr<std::vector<CollectedArea>> CollectNight(const NightPlan& plan,
                                                  const std::string& path,
                                                  const Context& context) {
  std::vector<CollectedArea> collected;
  for (std::size_t i = 0; i < plan.areas.size(); ++i) {
    CollectedArea area{plan.areas[i].area, nullptr, ""};
    StatusOr<Json> document = ReadDocument(ResultDocument(path, i));
    if (!document.ok()) {
      area.problem = fmt::format("no result: run --index {} again", i);
    } else {
      area.document = *std::move(document);
      const Status taken = context.dry_run() ? OkStatus() : Collect(plan, path, i, context);
      if (taken.code() == StatusCode::kUnavailable) return taken;
      if (!taken.ok()) area.problem = Message(taken);
    }
    collected.push_back(std::move(area));
  }
  return collected;
}

}  // namespace shiftmap
