// SPDX-License-Identifier: Apache-2.0
#include <pwd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/cli/aligned_table.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/parse_whole.h"
#include "tools/inspect/edit_text.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/store_arguments.h"

namespace shiftmap {
namespace {

constexpr char kList[] = "list";
constexpr char kUndo[] = "undo";
constexpr char kReset[] = "reset";

// A surveyed position farther than this from where runs saw the mode may be mistyped.
constexpr double kUnlikelySds = 5.0;

struct EditArguments {
  std::string action = kList;
  StoreArguments store;
  std::vector<std::string> words;
  std::string author;
  std::string reason;
  std::optional<double> sd_m;
  std::optional<std::int64_t> mode;
  bool is_new = false;
  double weight = 1.0;
  std::optional<double> since_s;
  std::vector<std::string> first_runs;
  std::vector<std::string> second_runs;
};

// Positional arguments of an action, for the usage message.
const char* UsageOf(const EditArguments& arguments) {
  const std::string& action = arguments.action;
  if (action == "position") {
    return arguments.is_new ? "SIGNATURE X,Y --new --sd S" : "SIGNATURE MODE X,Y --sd S";
  }
  if (action == "control") return "SIGNATURE X,Y --sd S";
  if (action == "retire") return "SIGNATURE";
  if (action == "rename") return "OLD NEW";
  if (action == "merge") return "SIGNATURE MODE INTO";
  if (action == "split") return "SIGNATURE MODE X,Y X,Y --sd S";
  if (action == "rate") return "SIGNATURE RATE";
  if (action == "calibration") return "reset VEHICLE --since T";
  return action == kUndo ? "ID" : "";
}

std::optional<Eigen::Vector2d> ParsePoint(const std::string& text) {
  const std::size_t comma = text.find(',');
  if (comma == std::string::npos) return std::nullopt;
  const std::optional<double> x = ParseWhole<double>(text.substr(0, comma));
  const std::optional<double> y = ParseWhole<double>(text.substr(comma + 1));
  if (!x || !y) return std::nullopt;
  return Eigen::Vector2d(*x, *y);
}

// The login name of who runs this.
std::string LoginName() {
  std::array<char, 4096> buffer{};
  passwd entry{};
  passwd* found = nullptr;
  if (getpwuid_r(getuid(), &entry, buffer.data(), buffer.size(), &found) != 0 || found == nullptr) {
    return "";
  }
  return found->pw_name;
}

std::string AuthorOf(const EditArguments& arguments) {
  return arguments.author.empty() ? LoginName() : arguments.author;
}

// Reads the words of an action. Returns false if they do not fit.
bool ReadPoint(const EditArguments& arguments, std::size_t word, MapEdit* edit) {
  const std::optional<Eigen::Vector2d> point = ParsePoint(arguments.words[word]);
  if (!point || !arguments.sd_m) return false;
  edit->p_map_landmark = *point;
  edit->sd_m = *arguments.sd_m;
  return true;
}

bool ReadMode(const std::string& word, ModeNumber* mode) {
  const std::optional<std::int64_t> number = ParseWhole<std::int64_t>(word);
  if (!number || *number < 1) return false;
  *mode = ModeNumber(*number);
  return true;
}

std::optional<MapEdit> ReadCalibration(const EditArguments& arguments, MapEdit edit) {
  const std::vector<std::string>& words = arguments.words;
  if (words.size() != 2 || words[0] != kReset || !arguments.since_s) return std::nullopt;
  edit.kind = EditKind::kCalibration;
  edit.signature = Signature();
  edit.vehicle = words[1];
  edit.since = StampFromSeconds(*arguments.since_s);
  return edit;
}

// The edit that the arguments say; nothing if they do not fit.
std::optional<MapEdit> ReadEdit(const EditArguments& arguments) {
  const std::vector<std::string>& words = arguments.words;
  if (words.empty()) return std::nullopt;
  MapEdit edit;
  edit.author = AuthorOf(arguments);
  edit.reason = arguments.reason;
  edit.signature = Signature(words[0]);
  const std::string& action = arguments.action;
  if (action == "calibration") return ReadCalibration(arguments, edit);
  bool fits = false;
  if (action == "position" && arguments.is_new) {
    edit.kind = EditKind::kNewMode;
    fits = words.size() == 2 && ReadPoint(arguments, 1, &edit);
  } else if (action == "position") {
    edit.kind = EditKind::kPosition;
    fits = words.size() == 3 && ReadMode(words[1], &edit.mode) && ReadPoint(arguments, 2, &edit);
  } else if (action == "control") {
    edit.kind = EditKind::kControl;
    if (arguments.mode) edit.mode = ModeNumber(*arguments.mode);
    fits = words.size() == 2 && ReadPoint(arguments, 1, &edit);
  } else if (action == "retire") {
    edit.kind = EditKind::kRetire;
    fits = words.size() == 1;
  } else if (action == "rename") {
    edit.kind = EditKind::kRename;
    fits = words.size() == 2;
    if (fits) edit.new_name = Signature(words[1]);
  } else if (action == "merge") {
    edit.kind = EditKind::kMerge;
    fits = words.size() == 3 && ReadMode(words[1], &edit.mode) && ReadMode(words[2], &edit.into);
  } else if (action == "split") {
    edit.kind = EditKind::kSplit;
    fits = words.size() == 4 && ReadMode(words[1], &edit.mode) && ReadPoint(arguments, 3, &edit);
    edit.p_map_second = edit.p_map_landmark;
    fits = fits && ReadPoint(arguments, 2, &edit);
    edit.first_runs = arguments.first_runs;
    edit.second_runs = arguments.second_runs;
  } else if (action == "rate") {
    edit.kind = EditKind::kRate;
    const std::optional<double> rate =
        words.size() == 2 ? ParseWhole<double>(words[1]) : std::optional<double>();
    fits = rate.has_value();
    edit.rate_per_s = rate.value_or(0.0);
    edit.weight = arguments.weight;
  }
  return fits ? std::optional(std::move(edit)) : std::nullopt;
}

// What an edit is for the published map, e.g. after a rollback.
const char* StateOf(const MapEdit& edit, bool is_in_map) {
  if (edit.undone) return is_in_map ? "taken back, still in the published map" : "taken back";
  return is_in_map ? "in force" : "not in the published map";
}

Status List(const StoreArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> edits, store.Edits(arguments.area));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto published, store.PublishedVersion(arguments.area));
  std::vector<MapEdit> held;
  if (published) {
    SHIFTMAP_ASSIGN_OR_RETURN(held, store.EditsOf(arguments.area, *published));
  }
  Json list = Json::array();
  AlignedTable table({"id", "state", "edit", "reason", "author", "made", "version", "taken_back"});
  table.KeepWide(2, 48);
  for (const MapEdit& edit : edits) {
    const bool is_in_map =
        std::any_of(held.begin(), held.end(), [&](const MapEdit& of) { return of.id == edit.id; });
    Json entry = EditJson(edit);
    entry["in_published_map"] = is_in_map;
    list.push_back(std::move(entry));
    table.AddRow({std::to_string(edit.id.value()),
                  StateOf(edit, is_in_map),
                  EditText(edit),
                  edit.reason,
                  edit.author,
                  TimeText(edit.made),
                  edit.version ? std::to_string(edit.version->value()) : "-",
                  edit.undone ? fmt::format("{} by {}: {}",
                                            TimeText(edit.undone->when),
                                            edit.undone->author,
                                            edit.undone->reason)
                              : ""});
  }
  context.Report({{"area", arguments.area}, {"edits", list}},
                 table.ToString(context.style(), "no edits"));
  return OkStatus();
}

StatusOr<MapStore> OpenForEdit(const EditArguments& arguments, const Context& context) {
  const auto access =
      context.dry_run() ? MapStore::Access::kReadOnly : MapStore::Access::kReadWrite;
  return OpenStore(arguments.store.store, access, context);
}

void ReportResult(const EditArguments& arguments,
                  const MapEdit& edit,
                  const EditResult& result,
                  Context& context) {
  Json document = {{"area", arguments.store.area}, {"edit", EditJson(edit)}};
  document["version"] = result.version ? Json(result.version->version.value()) : Json(nullptr);
  document["content_hash"] = result.version ? Json(result.version->content_hash) : Json(nullptr);
  document["rests_on"] = result.rests_on;
  document["moved_m"] = result.move ? Json(result.move->distance_m) : Json(nullptr);
  document["released"] = Json::array();
  for (const EditId id : result.released) document["released"].push_back(id.value());
  const bool undo = arguments.action == kUndo;
  std::string text = edit.id == EditId() ? "edit" : fmt::format("edit {}", edit.id.value());
  text += fmt::format(": {}{}\n", EditText(edit), undo ? ", taken back" : "");
  if (result.move) {
    text +=
        fmt::format("it moves by {:.3f} m, {:.1f} sd\n", result.move->distance_m, result.move->sds);
  }
  if (result.version) {
    text += fmt::format("version {} is published\n", result.version->version.value());
  } else if (context.dry_run()) {
    text += "nothing is written\n";
  }
  context.Report(document, text);
}

StatusOr<MapEdit> FindEdit(const std::string& area, EditId id, MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> edits, store->Edits(area));
  for (const MapEdit& edit : edits) {
    if (edit.id == id) return edit;
  }
  return NotFound("area '{}': no edit {}", area, id.value());
}

Status Make(const EditArguments& arguments, Context& context) {
  MapEdit edit = ReadEdit(arguments).value();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenForEdit(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const EditResult result,
                            store.Edit(arguments.store.area, edit, context.dry_run()));
  if (!context.dry_run()) {
    SHIFTMAP_ASSIGN_OR_RETURN(edit, FindEdit(arguments.store.area, result.edit, &store));
  }
  ReportResult(arguments, edit, result, context);
  if (result.move && result.move->sds > kUnlikelySds) {
    context.Attend(
        fmt::format("mode {} of '{}' moves by {:.3f} m, {:.0f} times its standard deviation: undo "
                    "the edit if its position is mistyped",
                    edit.mode.value(),
                    InertLine(edit.signature.text()),
                    result.move->distance_m,
                    result.move->sds));
  }
  for (const EditId id : result.released) {
    context.Attend(fmt::format("control point {} no longer holds: its mode {} of '{}' is merged",
                               id.value(),
                               edit.mode.value(),
                               InertLine(edit.signature.text())));
  }
  return OkStatus();
}

Status Undo(const EditArguments& arguments, Context& context) {
  const EditId id(ParseWhole<std::int64_t>(arguments.words[0]).value());
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenForEdit(arguments, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const EditResult result,
                            store.UndoEdit(arguments.store.area,
                                           id,
                                           {AuthorOf(arguments), arguments.reason, {}},
                                           context.dry_run()));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapEdit edit, FindEdit(arguments.store.area, id, &store));
  ReportResult(arguments, edit, result, context);
  if (result.rests_on) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        const std::string next,
        NextBuildText(arguments.store.area, "the next build goes on without it", &store));
    context.Attend(fmt::format("the published version was built on edit {}: {}", id.value(), next));
  }
  return OkStatus();
}

// An option that the action has no use for.
std::string Idle(const EditArguments& arguments) {
  const std::string& action = arguments.action;
  const bool surveys = action == "position" || action == "control" || action == "split";
  if (arguments.is_new && action != "position") return "--new is for position";
  if (arguments.mode && action != "control") return "--mode is for control";
  if (arguments.sd_m && !surveys) return "--sd is for position, control and split";
  const bool names_runs = !arguments.first_runs.empty() || !arguments.second_runs.empty();
  if (names_runs && action != "split") return "--first and --second are for split";
  if (arguments.since_s && action != "calibration") return "--since is for calibration reset";
  if (arguments.weight != 1.0 && action != "rate") return "--weight is for rate";
  return "";
}

std::string Misused(const EditArguments& arguments) {
  if (arguments.action == kList) {
    const bool idle = !arguments.words.empty() || !arguments.reason.empty();
    return idle ? "list takes no more arguments, and no --reason" : "";
  }
  if (std::string idle = Idle(arguments); !idle.empty()) return idle;
  const bool fits = arguments.action == kUndo ? arguments.words.size() == 1 &&
                                                    ParseWhole<std::int64_t>(arguments.words[0])
                                              : ReadEdit(arguments).has_value();
  if (!fits) return fmt::format("expected: edit {} {}", arguments.action, UsageOf(arguments));
  if (arguments.reason.empty()) return "expected --reason";
  return AuthorOf(arguments).empty() ? "expected --author" : "";
}

}  // namespace

void AddEditCommands(Application* application) {
  auto arguments = std::make_shared<EditArguments>();
  Command& command = application->AddCommand(
      "edit",
      "Edit the published map, or take an edit back: each makes a version that is published, and "
      "holds in every build to come",
      [arguments](Context& context) {
        if (arguments->action == kList) return List(arguments->store, context);
        return arguments->action == kUndo ? Undo(*arguments, context) : Make(*arguments, context);
      });
  AddStoreOptions(&arguments->store, &command);
  command.Option("ACTION", &arguments->action, "What to do")
      .OneOf({kList,
              "position",
              "control",
              "retire",
              "rename",
              "merge",
              "split",
              "rate",
              "calibration",
              kUndo})
      .Option(
          "WORD",
          &arguments->words,
          "position SIGNATURE MODE X,Y | position SIGNATURE X,Y --new | control SIGNATURE X,Y | "
          "retire SIGNATURE | rename OLD NEW | merge SIGNATURE MODE INTO | split SIGNATURE MODE "
          "X,Y X,Y | rate SIGNATURE RATE_PER_S | calibration reset VEHICLE | undo ID")
      .Option("--reason", &arguments->reason, "Why; it is kept with the edit")
      .Option("--author", &arguments->author, "Who (default: the login name)")
      .Option("--sd", &arguments->sd_m, "Standard deviation of a surveyed position, per axis, m")
      .Option("--mode",
              &arguments->mode,
              "Of a control point: the mode (default: the one that is clearly nearest)")
      .InRange(1.0, 1e9)
      .Option(
          "--first",
          &arguments->first_runs,
          "Of a split, several times: a run that met the landmark at the first place, as in runs")
      .Option("--second",
              &arguments->second_runs,
              "Of a split, several times: a run that met it at the second place; other runs count "
              "for both places")
      .Flag("--new", &arguments->is_new, "A mode that no run has seen")
      .Option("--weight",
              &arguments->weight,
              "Of a rate: as many visits, each of which found the landmark moved, it counts as")
      .Time(
          "--since", &arguments->since_s, "Of a calibration: what runs tell that end then or later")
      .Check([arguments] { return Misused(*arguments); })
      .Watchable([arguments] { return arguments->action == kList; })
      .Writes();
}

}  // namespace shiftmap
