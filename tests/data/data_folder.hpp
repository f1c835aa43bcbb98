// Base of the tests that need the recorded logs in the folder SUBMAPD_DATA.
//
// Without the folder such a test says so loudly and is skipped, which ctest shows (submapd_test's label "data"); with
// CI=true in the environment it fails instead.
#pragma once

#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string_view>

namespace submapd::test {

class DataTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const char* const folder = std::getenv("SUBMAPD_DATA");
    if (folder != nullptr && *folder != '\0') {
      folder_ = folder;
      if (!std::filesystem::is_directory(folder_)) FAIL() << "SUBMAPD_DATA=" << folder << " is no folder";
      return;
    }
    const char* const ci = std::getenv("CI");
    if (ci != nullptr && std::string_view(ci) == "true") FAIL() << "CI needs the recorded logs: set SUBMAPD_DATA";
    std::puts("*** SKIPPED: SUBMAPD_DATA is not set, so nothing is tested on recorded logs ***");
    GTEST_SKIP();
  }

  // REQUIRES: called from a test's body. The file may be missing: then the test that reads it fails.
  [[nodiscard]] std::filesystem::path data(std::string_view relative_path) const { return folder_ / relative_path; }

 private:
  std::filesystem::path folder_;
};

}  // namespace submapd::test
