// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/night_page.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <utility>

#include "mapstore/core/atomic_file.h"
#include "mapstore/core/folder.h"
#include "mapstore/core/inert_text.h"

namespace shiftmap {
namespace {

constexpr char kStyle[] = R"(
body{font:15px/1.45 system-ui,sans-serif;color:#222;background:#fff;max-width:1100px;margin:2em auto;padding:0 1em}
h1{font-size:1.5em}h2{font-size:1.25em;margin-top:2em;border-top:1px solid #ccc;padding-top:.8em}h3{font-size:1em;margin-bottom:.3em}
table{border-collapse:collapse;margin:.5em 0;display:block;overflow-x:auto}th,td{text-align:right;padding:.2em .8em;border-bottom:1px solid #e4e4e4;white-space:nowrap}
th:first-child,td:first-child{text-align:left}th{font-weight:600}td.t{text-align:left;white-space:normal}
.tag{display:inline-block;border-radius:3px;padding:0 .5em;font-weight:600}.ok{background:#dcefdc;color:#1d5a1d}.no{background:#f6dada;color:#8a1c1c}.none{background:#eee;color:#444}
li{overflow-wrap:anywhere}figure{margin:1em 0}figcaption{font-weight:600}img{max-width:100%;border:1px solid #ddd}
.pair{display:flex;flex-wrap:wrap;gap:1em}.pair figure{flex:1 1 420px;margin:0}
)";

std::string Html(const std::string& text) {
  std::string html = EscapeMarkup(InertLine(text));
  for (std::size_t at = html.find('\''); at != std::string::npos; at = html.find('\'', at)) {
    html.replace(at, 1, "&#39;");
  }
  return html;
}

std::string Base64(const std::string& bytes) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - i);
    for (std::size_t k = 0; k < 3; ++k) {
      group = group << 8U | (k < count ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      text += k <= count ? kDigits[group >> (18U - 6U * k) & 63U] : '=';
    }
  }
  return text;
}

std::string Text(const Json& value) {
  return value.is_string() ? value.get<std::string>() : value.is_null() ? "–" : value.dump();
}

std::string Number(const Json& value, int digits) {
  return value.is_number() ? fmt::format("{:.{}f}", value.get<double>(), digits) : "–";
}

std::string List(const Json& lines) {
  if (lines.empty()) return "";
  std::string html = "<ul>";
  for (const Json& line : lines) html += "<li>" + Html(Text(line)) + "</li>\n";
  return html + "</ul>\n";
}

std::string Tag(const Json& area) {
  if (area["alarm"].get<bool>()) return R"(<span class="tag no">alarm</span>)";
  if (area["published"].get<bool>()) return R"(<span class="tag ok">published</span>)";
  if (area["version"].is_null()) return R"(<span class="tag none">no version</span>)";
  return R"(<span class="tag no">not published</span>)";
}

std::string Summary(const Json& areas) {
  std::string html =
      "<table><tr><th>area</th><th>new runs</th><th>version</th><th></th><th>to see</th></tr>\n";
  for (const Json& area : areas) {
    html += fmt::format("<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
                        Html(Text(area["area"])),
                        area["runs_new"].get<int>(),
                        Text(area["version"]),
                        Tag(area),
                        area["reasons"].size());
  }
  return html + "</table>\n";
}

// Seconds in some of the states, as a share of all. [%]
std::string Doubt(const Json& score) {
  double all = 0.0;
  double doubt = 0.0;
  for (const auto& [state, seconds] : score["states"].items()) {
    all += seconds.get<double>();
    if (state != "TRACKING" && state != "MODE_CHANGED") doubt += seconds.get<double>();
  }
  return all > 0.0 ? fmt::format("{:.0f} %", 100.0 * doubt / all) : "–";
}

std::string Cells(const Json& before, const Json& after) {
  const auto cell = [](const Json& score, const std::function<std::string(const Json&)>& of) {
    return score.is_null() ? std::string("–") : of(score);
  };
  std::string html;
  const std::vector<std::function<std::string(const Json&)>> values = {
      [](const Json& score) { return Number(score["nis_per_dof"], 2); },
      Doubt,
      [](const Json& score) {
        return fmt::format("{} of {}", score["right"].get<int>(), score["met"].get<int>());
      }};
  for (const auto& of : values) {
    html += fmt::format("<td>{}</td><td>{}</td>", cell(before, of), cell(after, of));
  }
  return html;
}

// What a measure is, for people.
std::string Words(const std::string& measure) {
  if (measure == "nis") return "ln of NIS per degree of freedom, where above 1";
  if (measure == "doubt") return "share of time INITIALIZING, LOST or UNKNOWN_CHANGE";
  return "share of landmarks not decided for the mode that the mapper found";
}

// What the tests rest on, for people.
std::string BasisWords(const std::string& judged_by) {
  if (judged_by == "shifts") return "Judged by shifts that the build did not take, beside its own.";
  if (judged_by == "shifts_and_folds") {
    return "Judged, after a refusal, by mapped shifts that did not judge yet, and by its own new "
           "ones, each on a map that was built without its fold.";
  }
  if (judged_by == "folds") {
    return "No other shift could judge: each of its own is judged on a map that was built without "
           "its fold.";
  }
  if (judged_by == "own_shifts") {
    return "Judged by the build's own shifts alone: others were not there, and no fold could be "
           "built. What they gain counts nothing.";
  }
  return "There was nothing to judge it by.";
}

std::string JudgementHtml(const Json& judgement) {
  std::string html = fmt::format(
      "<p>Judged against {}. Cost per observation {} (before {}). {} landmarks and {} modes made, "
      "{} modes merged, {} removed.</p>\n",
      judgement["against"].is_null() ? "nothing: it is the first version"
                                     : "version " + Text(judgement["against"]),
      Number(judgement["cost_per_observation"]["after"], 2),
      Number(judgement["cost_per_observation"]["before"], 2),
      judgement["landmarks_made"].get<int>(),
      judgement["modes_made"].get<int>(),
      judgement["modes_merged"].get<int>(),
      judgement["modes_removed"].get<int>());
  html += fmt::format("<p>{}</p>\n", BasisWords(Text(judgement["judged_by"])));
  if (!judgement["moved"].empty()) {
    html += "<p>Moved beyond their covariance, which blocks nothing: ";
    for (const Json& name : judgement["moved"]) html += Html(Text(name)) + " ";
    html += "</p>\n";
  }
  html +=
      "<table><tr><th>measure, new minus old</th><th>shifts</th><th>mean</th><th>at most (95 "
      "%)</th>"
      "<th>margin</th><th></th></tr>\n";
  for (const Json& test : judgement["tests"]) {
    html +=
        fmt::format("<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
                    Words(Text(test["measure"])),
                    test["shifts"].get<int>(),
                    Number(test["mean"], 3),
                    Number(test["upper_95"], 3),
                    Number(test["margin"], 3),
                    test["not_worse"].get<bool>() ? "not worse" : "worse");
  }
  html +=
      "</table>\n<table><tr><th>shift</th><th>vehicle</th><th>in the build</th><th>NIS before</th>"
      "<th>after</th><th>in doubt before</th><th>after</th><th>landmarks right before</th>"
      "<th>after</th></tr>\n";
  for (const Json& shift : judgement["shifts"]) {
    html += fmt::format("<tr><td>{}</td><td>{}</td><td>{}</td>{}</tr>\n",
                        Html(std::filesystem::path(Text(shift["log"])).filename().string()),
                        Html(Text(shift["vehicle"])),
                        !shift["fold"].is_null()        ? "fold " + Text(shift["fold"])
                        : shift["in_build"].get<bool>() ? "yes"
                                                        : "no",
                        Cells(shift["before"], shift["after"]));
  }
  return html + "</table>\n";
}

std::string Figure(const PagePicture& picture) {
  return fmt::format(
      "<figure><figcaption>{}</figcaption><img alt=\"{}\" src=\"data:image/svg+xml;base64,{}\">"
      "</figure>\n",
      Html(picture.title),
      Html(picture.title),
      Base64(picture.svg));
}

std::string AreaHtml(const Json& area, const std::vector<PagePicture>& pictures) {
  std::string html = fmt::format("<h2>{} {}</h2>\n", Html(Text(area["area"])), Tag(area));
  html += List(area["reasons"]);
  if (!area["judgement"].is_null()) html += JudgementHtml(area["judgement"]);
  std::string small;
  for (const PagePicture& picture : pictures) {
    if (picture.area != Text(area["area"])) continue;
    if (picture.title.starts_with("Changes")) {
      html += Figure(picture);
    } else {
      small += Figure(picture);
    }
  }
  return small.empty() ? html : html + "<div class=\"pair\">" + small + "</div>\n";
}

// Runs a program silently. Whether it ended with exit code 0.
bool RunProgram(const std::vector<std::string>& words) {
  std::vector<char*> arguments;
  arguments.reserve(words.size() + 1);
  for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  for (const int fd : {STDOUT_FILENO, STDERR_FILENO}) {
    posix_spawn_file_actions_addopen(&actions, fd, "/dev/null", O_WRONLY, 0);
  }
  pid_t child = 0;
  const int error =
      posix_spawn(&child, words.front().c_str(), &actions, nullptr, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) return false;
  int status = 0;
  while (waitpid(child, &status, 0) < 0) {
    if (errno != EINTR) return false;
  }
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

// The picture that `shiftmap-inspect plot` draws; nothing if it does not.
std::optional<std::string> Plot(const std::vector<std::string>& words) {
  std::error_code error;
  const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", error);
  const std::string program = (self.parent_path() / "shiftmap-inspect").string();
  if (error || access(program.c_str(), X_OK) != 0) return std::nullopt;
  std::string file = (std::filesystem::temp_directory_path(error) / "shiftmap-XXXXXX.svg").string();
  const int fd = mkstemps(file.data(), 4);
  if (fd < 0) return std::nullopt;
  close(fd);
  std::vector<std::string> all = {program, "plot"};
  all.insert(all.end(), words.begin(), words.end());
  all.insert(all.end(), {"--output", file});
  std::optional<std::string> svg;
  if (RunProgram(all)) {
    std::ostringstream text;
    text << std::ifstream(file, std::ios::binary).rdbuf();
    svg = text.str();
  }
  std::filesystem::remove(file, error);
  return svg;
}

}  // namespace

std::vector<PagePicture> DrawNight(const Json& document, const std::string& store) {
  std::vector<PagePicture> pictures;
  for (const Json& area : document["areas"]) {
    if (area["version"].is_null()) continue;
    const std::string name = Text(area["area"]);
    const std::string version = Text(area["version"]);
    const auto add = [&](const std::string& title, std::vector<std::string> words) {
      words.insert(words.end(), {"--store=" + store, "--area=" + name});
      if (std::optional<std::string> svg = Plot(words)) {
        pictures.push_back({name, title, *std::move(svg)});
      }
    };
    add("Changes of version " + version, {"night", "--version=" + version});
    const Json& judgement = area["judgement"];
    if (!judgement.is_null() && !judgement["against"].is_null()) {
      const std::string before = Text(judgement["against"]);
      add("Before: version " + before, {"map", "--version=" + before});
      add("After: version " + version, {"map", "--version=" + version});
    }
  }
  return pictures;
}

std::string NightPage(const Json& document,
                      const std::string& title,
                      const std::vector<PagePicture>& pictures) {
  std::string html = fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; "
      "style-src 'unsafe-inline'\">\n<meta name=\"viewport\" content=\"width=device-width\">\n"
      "<title>Night {0}</title><style>{1}</style></head><body>\n<h1>Night {0}</h1>\n",
      Html(title),
      kStyle);
  html += fmt::format("<p>{} new reports, {} known.</p>\n",
                      document["reports"]["new"].get<int>(),
                      document["reports"]["known"].get<int>());
  html += Summary(document["areas"]);
  if (!document["left"].empty()) html += "<h3>Left out</h3>\n" + List(document["left"]);
  for (const Json& area : document["areas"]) html += AreaHtml(area, pictures);
  return html + "</body></html>\n";
}

Status WriteNightReport(const Json& document,
                        const std::string& title,
                        const std::string& store,
                        const std::string& folder) {
  SHIFTMAP_RETURN_IF_ERROR(MakeFolder(folder));
  std::string stem = folder + "/" + title;
  std::error_code error;
  for (int i = 2; std::filesystem::exists(stem + ".html", error); ++i) {
    stem = fmt::format("{}/{}-{}", folder, title, i);
  }
  SHIFTMAP_RETURN_IF_ERROR(WriteFileAtomically(stem + ".json", JsonText(document)));
  return WriteFileAtomically(stem + ".html",
                             NightPage(document, title, DrawNight(document, store)));
}

}  // namespace shiftmap
