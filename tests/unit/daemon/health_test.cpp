// What people read when a scanner is missing.
#include "daemon/health.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace submapd {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

Health health_without_horizontal_scanner() {
  Health health;
  health.scanners[0].configured = true;
  health.scanners[0].serial = "00900001";
  return health;
}

TEST(Health, SaysWhichScannerIsNotPluggedIn) {
  EXPECT_EQ(trouble_of(health_without_horizontal_scanner()), "horizontal scanner 00900001 is not plugged in");
}

TEST(Health, TellsThatTheSiteIsLargerThanTheGraph) {
  Health health = health_without_horizontal_scanner();
  health.scanners[0].present = true;
  health.publisher.lcm = true;
  health.optimizer.submaps_condensed = 100;
  EXPECT_EQ(trouble_of(health), "") << "known space: nothing is missing";
  health.optimizer.submaps_frozen = 7;
  EXPECT_THAT(trouble_of(health), AllOf(HasSubstr("oldest 7 sub-maps"), HasSubstr("[budget] graph")));
}

// It says its serial number only after it was opened.
TEST(Health, TellsOfAScannerThatIsPluggedInAndCannotBeOpened) {
  Health health = health_without_horizontal_scanner();
  health.scanners[0].words = "at port 1-1: no permission to open the device";
  EXPECT_THAT(trouble_of(health),
              AllOf(HasSubstr("00900001"), HasSubstr("at port 1-1: no permission"), Not(HasSubstr("not plugged in"))));
}

}  // namespace
}  // namespace submapd
