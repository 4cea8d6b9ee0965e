// SPDX-License-Identifier: Apache-2.0
//
// Processes that die while a shift is taken up.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "localizer/live/resume_mark.h"
#include "tests/unit/localizer/live/service_fixture.h"

namespace shiftmap::live {
namespace {

using testing::IsOk;

TEST(ResumeMarkTest, CountsAttemptsThatEndAtOnePlace) {
  const testing::TempDir folder;
  const std::string path = folder.File("mark");
  const auto attempt = [&](std::initializer_list<std::uint64_t> places) {
    const ResumeMark mark(path);
    for (const std::uint64_t place : places) EXPECT_THAT(mark.Reach(place), IsOk());
    return ResumeMark(path).failures();
  };
  EXPECT_EQ(ResumeMark(path).failures(), 0);
  EXPECT_EQ(attempt({0}), 1);
  EXPECT_EQ(attempt({0, 10000}), 1);
  EXPECT_EQ(attempt({0, 10000, 20000}), 1);
  EXPECT_EQ(attempt({0, 10000, 20000}), 2);
  EXPECT_EQ(attempt({0, 10000, 20000}), 3);
  ResumeMark(path).Clear();
  EXPECT_EQ(ResumeMark(path).failures(), 0);
  testing::WriteFile(path, "no number");
  EXPECT_EQ(ResumeMark(path).failures(), 0);
}

class ServiceResumeTest : public ServiceTest {
 protected:
  void BeginShift() {
    Service service = Opened();
    ASSERT_THAT(Do(&service, Start{.vehicle = "truck", .odometer_m = std::nullopt}), IsOk());
    uuid_ = service.State().report_uuid;
    Feed(&service, 0, 50);
  }

  // The process dies at the n-th call of the hook: the first record, or the rehearsal of the end.
  void DieResuming(int n) {
    ServiceOptions options = Options();
    int calls = 0;
    options.resuming = [&] {
      if (++calls == n) std::abort();
    };
    EXPECT_DEATH((void)Service::Open(options), "");
  }

  int KeptJournals() const {
    int kept = 0;
    for (const auto& entry : std::filesystem::directory_iterator(folder_.File("state"))) {
      if (entry.path().filename().string().starts_with("interrupted-")) ++kept;
    }
    return kept;
  }

  std::string uuid_;
};

TEST_F(ServiceResumeTest, AJournalThatEndsTheProcessTwiceIsKeptAsideAndAnotherShiftBegins) {
  for (const int place : {1, 2}) {
    BeginShift();
    DieResuming(place);
    DieResuming(place);
    warnings_.clear();
    Service service = Opened();
    ASSERT_EQ(warnings_.size(), 1u);
    EXPECT_NE(warnings_[0].find("2 times"), std::string::npos) << warnings_[0];
    EXPECT_NE(warnings_[0].find("interrupted-"), std::string::npos) << warnings_[0];
    EXPECT_EQ(KeptJournals(), place);
    const ServiceState state = service.State();
    EXPECT_TRUE(state.running);
    EXPECT_FALSE(state.resumed);
    EXPECT_NE(state.report_uuid, uuid_);
    Feed(&service, 0, items_.size());
    EXPECT_EQ(DecodeShiftReport(Stop(&service))->vehicle, "truck");
  }
}

TEST_F(ServiceResumeTest, FailuresBeforeAResumeThatSucceededDoNotCount) {
  BeginShift();
  for (int i = 0; i < 3; ++i) {
    DieResuming(2);
    EXPECT_EQ(Opened().State().report_uuid, uuid_);
    DieResuming(1);
    DieResuming(2);
    EXPECT_EQ(Opened().State().report_uuid, uuid_);
  }
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(ServiceResumeTest, AShiftIsTakenUpAfterAnyNumberOfLaterCrashes) {
  BeginShift();
  for (std::size_t life = 0; life < 12; ++life) {
    Service service = Opened();
    EXPECT_TRUE(service.State().resumed);
    EXPECT_EQ(service.State().report_uuid, uuid_);
    Feed(&service, 50 + life, 51 + life);
  }
  EXPECT_EQ(KeptJournals(), 0);
}

}  // namespace
}  // namespace shiftmap::live
