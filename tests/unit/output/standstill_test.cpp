#include "slam/output/standstill.hpp"

#include <gtest/gtest.h>

#include "tests/unit/output/scratch_folder.hpp"

namespace submapd {
namespace {

constexpr std::int64_t kSecond_us = 1'000'000;

// A spool at one pose a second.
class StandstillTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto made = PoseSpool::create(scratch_.path());
    ASSERT_TRUE(made) << made.error().message();
    spool_ = std::move(*made);
  }
  void stay(int seconds, const Pose2& at, bool keyframe = false) {
    for (int i = 0; i < seconds; ++i) {
      if (keyframe) newest_keyframe_ = static_cast<std::uint64_t>(now_s_);
      ASSERT_TRUE(spool_->add({now_s_ * kSecond_us, newest_keyframe_, at, {}, keyframe, true}).ok());
      ++now_s_;
    }
  }
  [[nodiscard]] std::vector<Standstill> found(std::int64_t after_s = -1) const {
    const auto found = find_standstills(*spool_, after_s * kSecond_us);
    EXPECT_TRUE(found);
    return found ? *found : std::vector<Standstill>{};
  }

  ScratchFolder scratch_;
  std::unique_ptr<PoseSpool> spool_;
  std::int64_t now_s_ = 0;
  std::uint64_t newest_keyframe_ = 0;
};

TEST_F(StandstillTest, IsWhereNothingMovedForLongEnough) {
  stay(1, {}, true);
  stay(9, {});  // second 0 to 9: too short
  stay(1, {0.2, 0.0, 0.0});
  stay(60, {0.1, 0.0, 0.0});  // second 11 to 70
  stay(5, {0.1, 0.0, 0.02});
  const auto all = found();
  ASSERT_EQ(all.size(), 1U);
  EXPECT_EQ(all[0].first_us, 13 * kSecond_us);
  EXPECT_EQ(all[0].last_us, 68 * kSecond_us);
  EXPECT_TRUE(all[0].contains(all[0].last_us));
  EXPECT_FALSE(all[0].contains(all[0].last_us + 1));
}

TEST_F(StandstillTest, ASlowDriftIsNone) {
  for (int i = 0; i < 100; ++i) stay(1, {0.002 * i, 0.0, 0.0});
  EXPECT_TRUE(found().empty());
}

TEST_F(StandstillTest, AKeyframeEndsIt) {
  stay(30, {});
  stay(1, {}, true);
  stay(30, {});
  const auto all = found();
  ASSERT_EQ(all.size(), 2U);
  EXPECT_LT(all[0].last_us, 30 * kSecond_us);
  EXPECT_GT(all[1].first_us, 30 * kSecond_us);
}

TEST_F(StandstillTest, BeginsAfterTheInstantAskedFor) {
  stay(100, {});
  const auto all = found(50);
  ASSERT_EQ(all.size(), 1U);
  EXPECT_EQ(all[0].first_us, 53 * kSecond_us);
}

}  // namespace
}  // namespace submapd
