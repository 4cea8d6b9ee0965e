// SPDX-License-Identifier: Apache-2.0
//
// What the programs say to inputs that are no regular files, and to texts that are hostile.
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <random>
#include <set>

#include "mapstore/core/csv.h"
#include "mapstore/core/inert_text.h"
#include "tests/scenario/command.h"
#include "tests/support/random_map.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

constexpr int kUsage = 2;
constexpr int kBadInput = 3;

constexpr const char* kHeader = "signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability\n";

class OddFilesTest : public ::testing::Test {
 protected:
  OddFilesTest() : store_(folder_.File("maps.db")) {
    WriteFile(folder_.File("survey.csv"), std::string(kHeader) + "A,1,1,2,0.1,0.1,1\n");
    RunForJson("shiftmap-mapper", Of({"import", folder_.File("survey.csv")}));
    EXPECT_EQ(mkfifo(folder_.File("fifo").c_str(), 0600), 0);
    socket_ = socket(AF_UNIX, SOCK_STREAM, 0);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, folder_.File("socket").c_str(), sizeof address.sun_path - 1);
    EXPECT_EQ(bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  ~OddFilesTest() override { close(socket_); }

  Arguments Of(Arguments words) const {
    words.insert(words.end(), {"--store", store_, "--area", "floor"});
    return words;
  }

  std::vector<std::string> OddFiles() const {
    return {folder_.File("fifo"),
            folder_.File("socket"),
            folder_.path(),
            "/dev/zero",
            "/dev/null",
            "/proc/self/mem"};
  }

  TempDir folder_;
  std::string store_;
  int socket_ = -1;
};

TEST_F(OddFilesTest, AsAnyInput) {
  for (const std::string& path : OddFiles()) {
    ExpectError("shiftmap-mapper", Of({"build", path}), kBadInput, path);
    ExpectError("shiftmap-mapper", Of({"import", path}), kBadInput, path);
    ExpectError("shiftmap-localizer", Of({"run", path}), kBadInput, path);
    ExpectError("shiftmap-localizer", {"return", "--store", store_, path}, kBadInput, path);
    ExpectError("shiftmap-eval", {"trajectory", path, path}, kBadInput, path);
    ExpectError("shiftmap-eval", Of({"map", path}), kBadInput, path);
    ExpectError("shiftmap-inspect", Of({"show", "--config", path}), kUsage, path);
  }
}

TEST_F(OddFilesTest, AsAStore) {
  for (const std::string& path : OddFiles()) {
    const Arguments store = {"--store", path, "--area", "floor"};
    for (const char* command : {"show", "modes", "versions"}) {
      Arguments words = store;
      words.insert(words.begin(), command);
      ExpectError("shiftmap-inspect", words, kBadInput, path);
    }
    ExpectError("shiftmap-inspect", {"verify", "--store", path}, kBadInput, path);
    ExpectError("shiftmap-localizer",
                {"run", "--snapshot", path, "--area", "floor", "run.mcap"},
                kBadInput,
                path);
    ExpectError("shiftmap-inspect",
                {"restore", "--store", folder_.File("restored.db"), path},
                kBadInput,
                path);
  }
}

TEST_F(OddFilesTest, ASurveyOfTooManyModesIsRefused) {
  std::string text = kHeader;
  for (int mode = 1; mode <= 1001; ++mode) {
    text += fmt::format("A,{},{},0,0.1,0.1,0\n", mode, mode);
  }
  const std::string path = folder_.File("many.csv");
  WriteFile(path, text);
  ExpectError("shiftmap-mapper",
              Of({"import", path}),
              kBadInput,
              path + ":1002: landmark 'A': more than 1000 modes");
}

TEST_F(OddFilesTest, ASurveyThatIsNotUtf8IsRefused) {
  const std::string path = folder_.File("latin1.csv");
  WriteFile(path, std::string(kHeader) + "T\xfcr,1,0,0,0.1,0.1,1\n");
  ExpectError(
      "shiftmap-mapper", Of({"import", path}), kBadInput, path + ":2: signature is not UTF-8");
}

// Exported as CSV, imported elsewhere, exported again: the same bytes, and no formula.
TEST_F(OddFilesTest, HostileSignaturesSurviveCsv) {
  std::mt19937_64 random(TestSeed(41));
  std::set<std::string> signatures = {
      "=cmd()",        "+1+1",  "-1",     "@SUM(A1)", "\tx",        "\rx", "'=1",     "a\"b",
      "a\"\"b",        "\"",    ",",      "#1",       "a\nb",       "'",   "\x1b[2K", "\a\u009b1A",
      "\u202egnp.exe", "\\x1b", "a\\\\b", " a ",      "a,\"b\"\r\n"};
  const std::string alphabet = "=+-@'\"#,\r\n\t a1\x1b\\x";
  for (int i = 0; i < 60; ++i) {
    std::string text(1 + random() % 6, ' ');
    for (char& c : text) c = alphabet[random() % alphabet.size()];
    signatures.insert(text);
  }
  std::string text = kHeader;
  for (const std::string& signature : signatures) {
    text += CsvText(signature) + ",1,-1.5,2,0.5,0.25,0.75\n";
  }
  const std::string survey = folder_.File("hostile.csv");
  WriteFile(survey, text);
  const std::string at = "1700000000";
  std::string previous;
  for (const char* name : {"one", "two"}) {
    const std::string store = folder_.File(name);
    const std::string source = previous.empty() ? survey : previous;
    previous = folder_.File(std::string(name) + ".csv");
    RunForJson("shiftmap-mapper",
               {"import", "--store", store, "--area", "a", "--stamp-s", at, source});
    const Arguments map = {"--store", store, "--area", "a", "--at", at};
    Arguments words = {"export", "--csv", "--output", previous};
    words.insert(words.end(), map.begin(), map.end());
    RunForJson("shiftmap-inspect", words);
    words = {"show"};
    words.insert(words.end(), map.begin(), map.end());
    std::set<std::string> shown;
    const Json document = RunForJson("shiftmap-inspect", words);
    for (const Json& group : document["groups"]) shown.insert(group["signature"]);
    EXPECT_EQ(shown, signatures);
  }
  EXPECT_EQ(ReadFile(folder_.File("two.csv")), ReadFile(folder_.File("one.csv")));
  EXPECT_EQ(ReadFile(folder_.File("one.csv")), text);
  std::erase(text, '\t');
  EXPECT_EQ(InertText(text), text);
}

TEST_F(OddFilesTest, ASurveyFromTheFutureIsRefused) {
  const Arguments import = {"import", folder_.File("survey.csv"), "--stamp-s", "9000000000"};
  ExpectError("shiftmap-mapper", Of(import), kBadInput, "ends at 2255-03-14 16:00:00 UTC");
  Arguments dry = import;
  dry.emplace_back("--dry-run");
  ExpectError("shiftmap-mapper", Of(dry), kBadInput, "s ahead");
  EXPECT_EQ(RunForJson("shiftmap-inspect", Of({"versions"}))["versions"].size(), 1U);
}

TEST_F(OddFilesTest, AWriteWithoutAnOutputIsDone) {
  const CommandResult result =
      RunCommand("shiftmap-mapper",
                 Of({"import", folder_.File("survey.csv"), "--no-publish"}),
                 {.output = "/dev/full"});
  EXPECT_EQ(result.exit_code, 8);
  EXPECT_EQ(CountLines(result.err), 1) << result.err;
  EXPECT_NE(result.err.find("it is done: version 2 of area 'floor'"), std::string::npos)
      << result.err;
  EXPECT_EQ(RunForJson("shiftmap-inspect", Of({"versions"}))["versions"].size(), 2U);
  EXPECT_EQ(RunCommand("shiftmap-inspect", Of({"versions"}), {.output = "/dev/full"}).exit_code,
            75);
}

}  // namespace
}  // namespace shiftmap::testing
