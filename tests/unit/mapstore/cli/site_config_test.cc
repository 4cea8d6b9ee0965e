// SPDX-License-Identifier: Apache-2.0
//
// One site file for all programs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <sstream>

#include "mapstore/cli/application.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

using ::testing::HasSubstr;

// Sets an environment variable while it lives.
class ScopedVariable {
 public:
  ScopedVariable(const char* name, const std::string& value) : name_(name) {
    ::setenv(name, value.c_str(), 1);
  }
  ~ScopedVariable() { ::unsetenv(name_); }
  ScopedVariable(const ScopedVariable&) = delete;
  ScopedVariable& operator=(const ScopedVariable&) = delete;

 private:
  const char* name_;
};

// Stands for shiftmap-mapper: it has `build`, and `nightly`.
struct Mapper {
  Mapper() : application("shiftmap-mapper", "") {
    application.AddCommand("build", "", [](Context&) { return OkStatus(); })
        .Option("--store", &store, "")
        .Required()
        .Option("--selector", &selector, "");
    application.AddCommand("nightly", "", [](Context&) { return OkStatus(); })
        .Option("--logs", &logs, "")
        .Option("--store", &nightly_store, "")
        .Option("--area", &area, "");
    application.AddConfigCommand();
  }

  int Run(const std::vector<std::string>& arguments) {
    out.str("");
    err.str("");
    return static_cast<int>(application.Run(arguments, &out, &err));
  }

  Application application;
  std::string store;
  std::string nightly_store;
  std::string selector = "viterbi";
  std::string logs;
  std::string area = "all";
  std::ostringstream out;
  std::ostringstream err;
};

class SiteConfigTest : public ::testing::Test {
 protected:
  void Write(const std::string& toml) { testing::WriteFile(path_, toml); }

  void ExpectError(const std::string& toml, const std::string& text) {
    Write(toml);
    Mapper mapper;
    EXPECT_EQ(mapper.Run({"build", "--config", path_}), 2) << toml;
    EXPECT_THAT(mapper.err.str(), HasSubstr(text));
    EXPECT_EQ(mapper.Run({"build", "--show-config", "--config", path_}), 2) << toml;
    EXPECT_THAT(mapper.err.str(), HasSubstr(text));
  }

  testing::TempDir dir_;
  std::string path_ = dir_.File("shiftmap.toml");
};

TEST_F(SiteConfigTest, TheCloserTableWins) {
  Write(
      "store = 'top'\n[mapper]\nstore = 'program'\n[build]\nselector = 'bare'\n"
      "[mapper.build]\nselector = 'full'\n[nightly]\nstore = 'command'\n");
  Mapper build;
  ASSERT_EQ(build.Run({"build", "--config", path_}), 0) << build.err.str();
  EXPECT_EQ(build.store, "program");
  EXPECT_EQ(build.selector, "full");
  Mapper nightly;
  ASSERT_EQ(nightly.Run({"nightly", "--config", path_}), 0) << nightly.err.str();
  EXPECT_EQ(nightly.nightly_store, "command");
}

// A key that is meant for other commands must not change what a night does.
TEST_F(SiteConfigTest, SomeOptionsAreSetInTheCommandsOwnTableAlone) {
  const auto area_of = [this](const std::string& toml, std::vector<std::string> words = {}) {
    Write(toml);
    Mapper mapper;
    words.insert(words.begin(), {"nightly", "--config", path_});
    EXPECT_EQ(mapper.Run(words), 0) << mapper.err.str();
    return mapper.area;
  };
  const ScopedVariable variable("SHIFTMAP_AREA", "of the environment");
  EXPECT_EQ(area_of("area = 'top'\n[mapper]\narea = 'program'\n"), "all");
  EXPECT_EQ(area_of("area = 'top'\n[nightly]\narea = 'own'\n"), "own");
  EXPECT_EQ(area_of("area = 'top'\n[mapper.nightly]\narea = 'full'\n"), "full");
  EXPECT_EQ(area_of("area = 'top'\n", {"--area", "given"}), "given");
}

TEST_F(SiteConfigTest, KeysOfOtherProgramsAreTheirs) {
  Write(
      "store = 's'\narea = 'a'\nserver = 'h:1'\n[localizer]\nanything = 1\n"
      "[localizer.serve]\nrate = 2\n[serve]\nrate = 3\n[runs]\nlimit = "
      "4\n[shiftmap-server]\nlisten = "
      "':1'\n");
  Mapper mapper;
  EXPECT_EQ(mapper.Run({"build", "--config", path_}), 0) << mapper.err.str();
}

TEST_F(SiteConfigTest, AMistakeIsAnErrorWithFileLineAndTheNearestName) {
  const std::string file = "config '" + path_;
  ExpectError("\nstroe = 's'\n", file + ":2': unknown key 'stroe'; did you mean 'store'?");
  ExpectError("[build]\nselecter = 1\n",
              ":2': unknown key 'build.selecter'; did you mean 'selector'");
  ExpectError("[mapper.build]\nlogs = 1\n", "unknown key 'mapper.build.logs'");
  ExpectError("[mapper.biuld]\nx = 1\n", "unknown table 'mapper.biuld'");
  ExpectError("[locali]\nx = 1\n", "unknown table 'locali'");
  ExpectError("[biuld]\nx = 1\n", "did you mean 'build'?");
  ExpectError("config = 'other'\n", "unknown key 'config'");
}

TEST_F(SiteConfigTest, TheVariableNamesTheFileAndTheOptionWins) {
  Write("store = 'a'\n");
  const ScopedVariable variable("SHIFTMAP_CONFIG", path_);
  Mapper mapper;
  ASSERT_EQ(mapper.Run({"build"}), 0) << mapper.err.str();
  EXPECT_EQ(mapper.store, "a");
  const std::string other = dir_.File("other.toml");
  testing::WriteFile(other, "store = 'b'\n");
  Mapper given;
  ASSERT_EQ(given.Run({"build", "--config", other}), 0) << given.err.str();
  EXPECT_EQ(given.store, "b");
}

TEST_F(SiteConfigTest, TheEnvironmentWinsOverTheFileAndTheCommandLineOverBoth) {
  Write("store = 'file'\n");
  const ScopedVariable variable("SHIFTMAP_STORE", "environment");
  Mapper mapper;
  ASSERT_EQ(mapper.Run({"build", "--config", path_}), 0) << mapper.err.str();
  EXPECT_EQ(mapper.store, "environment");
  Mapper given;
  ASSERT_EQ(given.Run({"build", "--config", path_, "--store", "x"}), 0);
  EXPECT_EQ(given.store, "x");
}

TEST_F(SiteConfigTest, HelpIsThereWhateverTheFileSays) {
  Write("nonsense");
  Mapper mapper;
  EXPECT_EQ(mapper.Run({"build", "--config", path_, "--help"}), 0);
}

TEST_F(SiteConfigTest, TheConfigCommandTellsWhatHoldsAndWhy) {
  Write("store = 's'\n[build]\nselector = 'mcts'\n[localizer]\nrate = 1\n");
  const ScopedVariable variable("SHIFTMAP_CONFIG", path_);
  Mapper mapper;
  ASSERT_EQ(mapper.Run({"config", "build", "--store", "here", "--json"}), 0) << mapper.err.str();
  const Json document = Json::parse(mapper.out.str());
  EXPECT_EQ(document["file"], path_);
  EXPECT_EQ(document["file_source"], "SHIFTMAP_CONFIG");
  EXPECT_EQ(document["tables_of_other_programs"], Json::parse(R"(["localizer"])"));
  std::map<std::string, std::pair<std::string, std::string>> keys;
  for (const Json& key : document["keys"]) {
    keys[key["key"]] = {key["value"].is_null() ? "" : key["value"].get<std::string>(),
                        key["source"]};
  }
  EXPECT_EQ(keys["store"], std::pair(std::string("here"), std::string("command line")));
  EXPECT_EQ(keys["selector"], std::pair(std::string("mcts"), path_ + ":3"));
  EXPECT_EQ(keys["log-level"].second, "default");

  Mapper all;
  ASSERT_EQ(all.Run({"config"}), 0) << all.err.str();
  EXPECT_THAT(all.out.str(), HasSubstr(path_ + ":1"));
  Mapper wrong;
  EXPECT_EQ(wrong.Run({"config", "biuld"}), 2);
  EXPECT_THAT(wrong.err.str(), HasSubstr("did you mean 'build'?"));
}

// Also where what the command needs is missing: that is when somebody asks.
TEST_F(SiteConfigTest, EveryProgramShowsWhatHoldsForItsCommands) {
  Write("[shiftmap-server]\nlisten = '0.0.0.0:1'\n[nightly]\nlogs = 'there'\n");
  Application server("shiftmap-server", "");
  std::string listen;
  std::string key;
  server.AddCommand("", "", [](Context&) { return Internal("it ran"); })
      .Option("--listen", &listen, "")
      .Required()
      .Option("--tls-key", &key, "")
      .Required();
  std::ostringstream out;
  std::ostringstream err;
  EXPECT_EQ(server.Run({"--show-config", "--config", path_}, &out, &err), ExitCode::kDone);
  EXPECT_THAT(out.str(), HasSubstr("0.0.0.0:1"));
  EXPECT_THAT(out.str(), HasSubstr(path_ + ":2"));
  EXPECT_EQ(err.str(), "");

  Mapper mapper;
  ASSERT_EQ(
      mapper.Run({"nightly", "--area", "floor", "--show-config", "--json", "--config=" + path_}),
      0);
  const Json document = Json::parse(mapper.out.str());
  const auto row = [&](const std::string& of) {
    for (const Json& each : document["keys"]) {
      if (each["key"] == of) return each;
    }
    return Json();
  };
  EXPECT_EQ(row("area")["source"], "command line");
  EXPECT_EQ(row("logs")["value"], "there");
  EXPECT_TRUE(row("selector").is_null());
  EXPECT_TRUE(row("show-config").is_null());
}

}  // namespace
}  // namespace shiftmap
