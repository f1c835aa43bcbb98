// Roles are given by configuration or not at all.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "driver/sensor_roles.hpp"

namespace submapd::driver {
namespace {

using testing::HasSubstr;

const std::vector<std::string> kPresent = {"00903971", "00900001"};

Expected<SensorRole> ask(const RoleRules& rules, const char* serial, const char* port) {
  return find_role(rules, {serial, "", "", port}, kPresent);
}

TEST(SensorRoles, SerialsMatchAsSentAndAsPrinted) {
  EXPECT_TRUE(same_serial("H0903971", "00903971"));
  EXPECT_TRUE(same_serial("00903971", "H0903971"));
  EXPECT_TRUE(same_serial("00903971", "00903971"));
  EXPECT_FALSE(same_serial("00903971", "00903972"));
  EXPECT_FALSE(same_serial("H0903971", "0903971"));
  EXPECT_FALSE(same_serial("10903971", "H0903971"));
  EXPECT_FALSE(same_serial("", "0"));
  EXPECT_FALSE(same_serial("H", "0"));
}

TEST(SensorRoles, SerialDecidesWhateverThePort) {
  const RoleRules rules = {RoleRule{"H0903971", ""}, RoleRule{"H0900001", ""}};
  EXPECT_EQ(ask(rules, "00903971", "1-2"), SensorRole::kHorizontal);
  EXPECT_EQ(ask(rules, "00900001", "1-1"), SensorRole::kVertical);
}

TEST(SensorRoles, SerialBeatsThePortOfTheOtherRole) {
  const RoleRules rules = {RoleRule{"H0903971", ""}, RoleRule{"", "1-1"}};
  EXPECT_EQ(ask(rules, "00903971", "1-1"), SensorRole::kHorizontal);
  EXPECT_EQ(ask(rules, "00900001", "1-1"), SensorRole::kVertical);
}

TEST(SensorRoles, WithoutARuleItRefusesAndNamesTheCommandAndTheScanners) {
  const auto nobody = ask({}, "00903971", "1-1");
  ASSERT_FALSE(nobody.has_value());
  EXPECT_EQ(nobody.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(nobody.error().message, HasSubstr("submapctl sensors --assign H=SERIAL V=SERIAL"));
  EXPECT_THAT(nobody.error().message, HasSubstr("00903971, 00900001"));
}

TEST(SensorRoles, DoubledRulesAreRefused) {
  const RoleRules rules = {RoleRule{"H0903971", ""}, RoleRule{"00903971", ""}};
  ASSERT_FALSE(ask(rules, "00903971", "1-1").has_value());
  EXPECT_EQ(ask(rules, "00903971", "1-1").error().code, ErrorCode::kInvalidArgument);
}

}  // namespace
}  // namespace submapd::driver
