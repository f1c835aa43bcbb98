#include "daemon/mark_list.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace submapd {
namespace {

std::vector<std::string> names_of(const MarkList& marks) {
  std::vector<std::string> names;
  for (const Mark& mark : marks.in_order()) names.push_back(mark.name);
  return names;
}

TEST(MarkListTest, KnowsARequestThatComesAgain) {
  MarkList marks({{"door", 10}, {"lift", 30}});
  EXPECT_FALSE(marks.find("a", "stairs", std::nullopt).has_value());
  marks.add("a", {"stairs", 20});
  EXPECT_THAT(names_of(marks), testing::ElementsAre("door", "stairs", "lift"));

  ASSERT_TRUE(marks.find("a", "stairs", std::nullopt).has_value());
  EXPECT_EQ(marks.find("a", "stairs", std::nullopt)->utime_us, 20) << "the instant it got then, not now";
  EXPECT_FALSE(marks.find("a", "door", std::nullopt).has_value()) << "another request by a careless asker";
  EXPECT_FALSE(marks.find("b", "stairs", std::nullopt).has_value()) << "the same place, visited again";
  EXPECT_FALSE(marks.find("", "stairs", std::nullopt).has_value());
}

TEST(MarkListTest, ThereIsOneMarkOfANameAtAnInstant) {
  MarkList marks({{"door", 10}});
  marks.add("", {"pole", 10});
  EXPECT_TRUE(marks.find("", "door", 10).has_value()) << "also after a restart, which forgets requests";
  EXPECT_TRUE(marks.find("", "pole", 10).has_value());
  EXPECT_FALSE(marks.find("", "door", 11).has_value());
  EXPECT_FALSE(marks.find("", "lift", 10).has_value());
}

TEST(MarkListTest, RemembersTheNewestRequestsOnlyAndKeepsAllMarks) {
  MarkList marks({});
  for (std::size_t i = 0; i <= MarkList::kRemembered; ++i) {
    marks.add(std::to_string(i), {"m", static_cast<std::int64_t>(i)});
  }
  EXPECT_FALSE(marks.find("0", "m", std::nullopt).has_value());
  EXPECT_TRUE(marks.find("1", "m", std::nullopt).has_value());
  EXPECT_EQ(marks.in_order().size(), MarkList::kRemembered + 1);
  EXPECT_FALSE(marks.full());
}

}  // namespace
}  // namespace submapd
