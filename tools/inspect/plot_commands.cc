// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/atomic_file.h"
#include "mapstore/core/inert_text.h"
#include "tools/inspect/inspect_commands.h"
#include "tools/inspect/plot_pictures.h"
#include "tools/inspect/store_arguments.h"
#include "tools/plot/png.h"

namespace shiftmap {
namespace {

constexpr char kSvg[] = ".svg";
constexpr char kPng[] = ".png";

struct PlotArguments : PictureArguments {
  std::string what = "map";
  std::string output;
  std::optional<std::int64_t> width_px = std::nullopt;
};

// A kind of picture.
struct Kind {
  const char* name;
  std::size_t least;     // Number of subjects,
  std::size_t most;      // at least and at most,
  const char* subjects;  // and how they are called.
  bool of_map;           // Needs --store and --area.
  bool truth;            // May be compared with --truth.
  StatusOr<Picture> (*draw)(const PictureArguments&, const Context&);
};

constexpr std::size_t kAny = 100;

constexpr Kind kKinds[] = {
    {"map", 0, 0, "nothing more", true, false, DrawMap},
    {"modes", 1, 1, "a signature", true, false, DrawModes},
    {"history", 1, 1, "a signature", true, false, DrawHistory},
    {"diff", 2, 2, "two versions", true, false, DrawDiff},
    {"trajectory", 1, kAny, "a trajectory in TUM format, or several", true, true, DrawTrajectories},
    {"consistency", 1, 1, "a recording of shiftmap-localizer", false, true, DrawConsistency},
    {"rates", 0, 0, "nothing more", true, false, DrawRates},
    {"night", 0, 0, "nothing more", true, false, DrawNight},
};

const Kind& KindNamed(const std::string& name) {
  return *std::find_if(
      std::begin(kKinds), std::end(kKinds), [&](const Kind& kind) { return kind.name == name; });
}

std::vector<std::string> KindNames() {
  std::vector<std::string> names;
  for (const Kind& kind : kKinds) names.emplace_back(kind.name);
  return names;
}

std::string EndingOf(const std::string& path) {
  std::string ending = std::filesystem::path(path).extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(), [](unsigned char c) {
    return static_cast<char>(std::tolower(c));
  });
  return ending;
}

bool AreVersions(const std::vector<std::string>& words) {
  return std::all_of(words.begin(), words.end(), [](const std::string& word) {
    return word.find_first_not_of("0123456789") == std::string::npos;
  });
}

std::string CheckPlot(const PlotArguments& arguments) {
  const std::string ending = EndingOf(arguments.output);
  if (ending != kSvg && ending != kPng) {
    return fmt::format(
        "--output '{}': expected a name that ends in {} or {}", arguments.output, kSvg, kPng);
  }
  if (arguments.width_px && ending != kPng) return "--width-px is for PNG";
  const Kind& kind = KindNamed(arguments.what);
  const std::size_t count = arguments.subjects.size();
  if (count < kind.least || count > kind.most) {
    return fmt::format("plot {}: expected {}, got {} words", kind.name, kind.subjects, count);
  }
  if (arguments.what == "diff" && !AreVersions(arguments.subjects)) {
    return fmt::format("plot diff: expected {}", kind.subjects);
  }
  if (kind.of_map && arguments.store.store.empty()) return "--store is required";
  if (kind.of_map && arguments.store.area.empty()) return MissingArea(arguments.store);
  if (!kind.truth && !arguments.truth.empty()) {
    return fmt::format("plot {}: --truth is for trajectory and consistency", kind.name);
  }
  if (arguments.align && arguments.truth.empty()) return "--align is for --truth";
  return "";
}

Status RunPlot(const PlotArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Picture picture,
                            KindNamed(arguments.what).draw(arguments, context));
  std::string file = picture.svg;
  if (EndingOf(arguments.output) == kPng) {
    SHIFTMAP_ASSIGN_OR_RETURN(file, RenderPng(picture.svg, arguments.width_px));
  }
  if (!context.dry_run()) SHIFTMAP_RETURN_IF_ERROR(WriteFileAtomically(arguments.output, file));
  Json document = {{"picture", arguments.what}};
  document.update(picture.about);
  document["output"] = arguments.output;
  document["bytes"] = file.size();
  context.Report(document, InertLine(arguments.output) + "\n");
  return OkStatus();
}

}  // namespace

void AddPlotCommand(Application* application) {
  auto plot = std::make_shared<PlotArguments>();
  Command& command =
      application->AddCommand("plot", "Draw a picture as SVG or PNG", [plot](Context& context) {
        return RunPlot(*plot, context);
      });
  AddMapOptions(&plot->store, &command, false);
  AddKnownOption(&plot->store, &command);
  command
      .Option("WHAT",
              &plot->what,
              "The map; the modes or the history of a landmark; the difference of two versions; "
              "trajectories on the map; whether a localizer's covariances are right; move rates; "
              "or the changes of the last build")
      .OneOf(KindNames())
      .Option(
          "SUBJECT",
          &plot->subjects,
          "Of modes and history: the signature of a landmark; of diff: two versions; of "
          "trajectory: files in TUM format; of consistency: the file of localizer run --recording")
      .Option("--output", &plot->output, "File to write, .svg or .png")
      .Output()
      .Required()
      .Option("--width-px", &plot->width_px, "Width of a PNG (default: twice that of the SVG)")
      .InRange(100, kMaxPngWidthPx)
      .Option("--truth", &plot->truth, "True trajectory in TUM format, to compare with")
      .Flag("--align", &plot->align, "Move the truth onto the estimate first")
      .Check([plot] { return CheckPlot(*plot); })
      .Writes();
}

}  // namespace shiftmap
