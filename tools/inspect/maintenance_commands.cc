// SPDX-License-Identifier: Apache-2.0
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "mapstore/cli/aligned_table.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/count_text.h"
#include "mapstore/core/day.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/maintenance/backup.h"
#include "mapstore/maintenance/compact.h"
#include "mapstore/maintenance/migrate.h"
#include "mapstore/maintenance/verify.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/store_arguments.h"

namespace shiftmap {
namespace {

struct BackupArguments {
  std::string store;
  std::string output;
};

struct RestoreArguments {
  std::string store;
  std::string backup;
  bool replace = false;
};

struct CompactArguments {
  std::string store;
  int keep_versions = RetentionPolicy().keep_versions;
  std::optional<double> evidence_days;
  std::optional<double> thin_days;
};

struct MigrateArguments {
  std::string store;
  std::string backup;
};

Status Unsound(const std::string& path, const VerifyResult& result) {
  return DataLoss("map store '{}': {}", path, CountText(result.defect_count, "defect"));
}

Status RunVerify(const std::string& path, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const VerifyResult result, VerifyStore(path));
  Json defects = Json::array();
  AlignedTable table({"table", "row", "problem"});
  for (const Defect& defect : result.defects) {
    defects.push_back({{"table", defect.table}, {"row", defect.row}, {"problem", defect.problem}});
    table.AddRow({defect.table, defect.row, defect.problem});
  }
  const Json document = {{"store", path},
                         {"versions", result.versions},
                         {"reports", result.reports},
                         {"evidence_rows", result.evidence_rows},
                         {"checkpoints", result.checkpoints},
                         {"defects", result.defect_count},
                         {"list", defects},
                         {"findings", result.findings}};
  const std::string looked_at = fmt::format("{}, {}, {}, {}",
                                            CountText(result.versions, "version"),
                                            CountText(result.reports, "report"),
                                            CountText(result.evidence_rows, "evidence row"),
                                            CountText(result.checkpoints, "ledger checkpoint"));
  context.Report(document,
                 result.clean() ? looked_at + ": all sound\n"
                                : table.ToString(context.style()) + looked_at + "\n");
  for (const std::string& finding : result.findings) {
    context.Attend(fmt::format("map store '{}': {}", path, finding));
  }
  if (result.clean()) return OkStatus();
  return Unsound(path, result);
}

Status RunBackup(const BackupArguments& arguments, Context& context) {
  if (context.dry_run()) {
    SHIFTMAP_ASSIGN_OR_RETURN(const VerifyResult result, VerifyStore(arguments.store));
    if (!result.clean()) return Unsound(arguments.store, result);
    context.Report({{"output", arguments.output}}, "the store is sound\n");
    return OkStatus();
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const BackupResult result,
                            BackupStore(arguments.store, arguments.output));
  context.Report({{"output", arguments.output},
                  {"sha256", result.sha256},
                  {"digest", result.digest},
                  {"bytes", result.bytes}},
                 fmt::format("{}: {} bytes, sha256 {}\nrows {}\n",
                             InertLine(arguments.output),
                             result.bytes,
                             result.sha256,
                             result.digest));
  return OkStatus();
}

Status RunRestore(const RestoreArguments& arguments, Context& context) {
  if (context.dry_run()) {
    SHIFTMAP_ASSIGN_OR_RETURN(const VerifyResult result, VerifyStore(arguments.backup));
    if (!result.clean()) return Unsound(arguments.backup, result);
    std::error_code error;
    if (!arguments.replace && std::filesystem::exists(arguments.store, error)) {
      return FailedPrecondition(
          "map store '{}': exists already, and is replaced only with --replace", arguments.store);
    }
    context.Report({{"store", arguments.store}}, "the backup is sound\n");
    return OkStatus();
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const RestoreResult result,
                            RestoreStore(arguments.backup, arguments.store, arguments.replace));
  Json document = {{"store", arguments.store},
                   {"backup_sha256", result.restored.sha256},
                   {"digest", result.restored.digest}};
  std::string text = fmt::format("{} is as {}: rows {}\n",
                                 InertLine(arguments.store),
                                 InertLine(arguments.backup),
                                 result.restored.digest);
  if (result.kept) {
    document["kept"] = *result.kept;
    text += fmt::format("what was there is kept as {}\n", InertLine(*result.kept));
  }
  context.Report(document, text);
  return OkStatus();
}

Status RunCompact(const CompactArguments& arguments, Context& context) {
  RetentionPolicy policy;
  policy.keep_versions = arguments.keep_versions;
  if (arguments.evidence_days) {
    policy.evidence_before = SystemNow() - FromSeconds(kSecondsPerDay * *arguments.evidence_days);
  }
  if (arguments.thin_days) {
    policy.thin_before = SystemNow() - FromSeconds(kSecondsPerDay * *arguments.thin_days);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const CompactResult result,
                            CompactStore(arguments.store, policy, context.dry_run()));
  context.Report({{"store", arguments.store},
                  {"versions", result.versions},
                  {"evidence_rows", result.evidence_rows},
                  {"thinned_rows", result.thinned_rows},
                  {"decisions", result.decisions},
                  {"bytes_before", result.bytes_before},
                  {"bytes_after", result.bytes_after}},
                 fmt::format("{}content of {}, {} that no version needs, {} that say what others "
                             "say, {}; {} bytes before, {} after\n",
                             context.dry_run() ? "would delete " : "deleted ",
                             CountText(result.versions, "version"),
                             CountText(result.evidence_rows, "evidence row"),
                             result.thinned_rows,
                             CountText(result.decisions, "decision"),
                             result.bytes_before,
                             result.bytes_after));
  return OkStatus();
}

Status RunMigrate(const MigrateArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const MigrateResult result,
                            MigrateStore(arguments.store, arguments.backup, context.dry_run()));
  context.Report({{"store", arguments.store},
                  {"from", result.from},
                  {"to", result.to},
                  {"backup", result.backup}},
                 fmt::format("{}: {}schema {} to {}; as it was: {}\n",
                             InertLine(arguments.store),
                             context.dry_run() ? "would go from " : "",
                             result.from,
                             result.to,
                             InertLine(result.backup)));
  return OkStatus();
}

}  // namespace

void AddMaintenanceCommands(Application* application) {
  auto verify = std::make_shared<std::string>();
  application
      ->AddCommand(
          "verify",
          "Check everything that a store promises; exit code 3 if something is wrong, 8 if "
          "stamps are ahead of this host's clock",
          [verify](Context& context) { return RunVerify(*verify, context); })
      .Option("--store", verify.get(), "Map store, or a snapshot")
      .Required()
      .Watchable();

  auto backup = std::make_shared<BackupArguments>();
  application
      ->AddCommand("backup",
                   "Copy a store while others use it, and verify the copy",
                   [backup](Context& context) { return RunBackup(*backup, context); })
      .Option("--store", &backup->store, "Map store")
      .Required()
      .Option("--output", &backup->output, "File to write; replaced")
      .Output()
      .Required()
      .Writes();

  auto restore = std::make_shared<RestoreArguments>();
  Command& restore_command = application->AddCommand(
      "restore", "Make a store what a backup of it is", [restore](Context& context) {
        return RunRestore(*restore, context);
      });
  restore_command.Option("--store", &restore->store, "Map store to write").Required();
  restore_command.Option("BACKUP", &restore->backup, "Backup to read").Required();
  restore_command.Flag(
      "--replace", &restore->replace, "Replace the store that is there; it is kept beside");
  restore_command.Writes();

  auto compact = std::make_shared<CompactArguments>();
  Command& compact_command = application->AddCommand(
      "compact",
      "Delete the content of old versions, and evidence that no kept version needs or that repeats "
      "other evidence",
      [compact](Context& context) { return RunCompact(*compact, context); });
  compact_command.Option("--store", &compact->store, "Map store").Required();
  compact_command
      .Option("--keep-versions",
              &compact->keep_versions,
              "Newest versions of each area to keep, besides the published one")
      .InRange(1, 1e6);
  compact_command
      .Option("--evidence-days",
              &compact->evidence_days,
              "Delete evidence older than this that counts for no kept version (default: keep)")
      .InRange(0, 1e5);
  compact_command
      .Option("--thin-days",
              &compact->thin_days,
              "Delete evidence older than this that repeats what is before and after it (default: "
              "keep)")
      .InRange(0, 1e5);
  compact_command.Writes();

  auto migrate = std::make_shared<MigrateArguments>();
  Command& migrate_command = application->AddCommand(
      "migrate",
      "Bring a store of an older build to the schema of this one",
      [migrate](Context& context) { return RunMigrate(*migrate, context); });
  migrate_command.Option("--store", &migrate->store, "Map store").Required();
  migrate_command.Option(
      "--backup", &migrate->backup, "Where to keep the store as it was (default: beside it)");
  migrate_command.Writes();
}

}  // namespace shiftmap
