#include "slam/base/status.hpp"

#include <gtest/gtest.h>

#include <memory>

namespace submapd {
namespace {

TEST(StatusTest, DefaultIsOkWithoutMessage) {
  const Status status;
  EXPECT_TRUE(status.ok());
  EXPECT_EQ(status.code(), StatusCode::kOk);
  EXPECT_EQ(status.message(), "");
}

TEST(StatusTest, KeepsCodeAndMessage) {
  const Status status(StatusCode::kCorrupt, "map.pgm: cut off");
  EXPECT_FALSE(status.ok());
  EXPECT_EQ(status.code(), StatusCode::kCorrupt);
  EXPECT_EQ(status.message(), "map.pgm: cut off");
}

Expected<std::unique_ptr<int>> half_of(int value) {
  if (value % 2 != 0) return failure(StatusCode::kInvalidArgument, "odd");
  return std::make_unique<int>(value / 2);
}

Expected<int> quarter_of(int value) {
  auto half = half_of(value);
  if (!half) return failure(half.error());
  auto quarter = half_of(**half);
  if (!quarter) return failure(quarter.error());
  return **quarter;
}

TEST(ExpectedTest, CarriesValuesAndPassesErrorsOn) {
  EXPECT_EQ(quarter_of(12).value(), 3);
  for (const int bad : {7, 6}) {
    const Expected<int> result = quarter_of(bad);
    ASSERT_FALSE(result.has_value());
    EXPECT_EQ(result.error().code(), StatusCode::kInvalidArgument);
    EXPECT_EQ(result.error().message(), "odd");
  }
}

}  // namespace
}  // namespace submapd
