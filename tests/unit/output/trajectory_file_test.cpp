#include "slam/output/trajectory_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <limits>
#include <sstream>

#include "tests/unit/output/scratch_folder.hpp"

namespace submapd {
namespace {

using testing::HasSubstr;

Expected<std::vector<StampedPose>> parse(const std::string& text) {
  std::istringstream in(text);
  return read_tum(in, "test.tum");
}

TEST(SecondsTextTest, IsExact) {
  EXPECT_EQ(seconds_text(0), "0.000000");
  EXPECT_EQ(seconds_text(1), "0.000001");
  EXPECT_EQ(seconds_text(-1), "-0.000001");
  EXPECT_EQ(seconds_text(1500000), "1.500000");
  EXPECT_EQ(seconds_text(1714566612123457), "1714566612.123457");
  EXPECT_EQ(seconds_text(-1500000), "-1.500000");
  EXPECT_EQ(seconds_text(std::numeric_limits<std::int64_t>::max()), "9223372036854.775807");
  EXPECT_EQ(seconds_text(std::numeric_limits<std::int64_t>::min()), "-9223372036854.775808");
}

RC_GTEST_PROP(SecondsTextTest, ComesBackBitByBit, (std::int64_t stamp_us)) {
  const auto read = parse(seconds_text(stamp_us) + " 0 0 0 0 0 0 1\n");
  RC_ASSERT(read.has_value());
  RC_ASSERT(read->front().stamp_us == stamp_us);
}

TEST(TrajectoryFileTest, WritesTheDocumentedForm) {
  const ScratchFolder folder;
  TrajectoryFile file(folder.path() / "a.tum");
  ASSERT_TRUE(file.add(1000000, {1.0, -2.5, 0.0}).ok());
  ASSERT_TRUE(file.add(1025000, {1.25, -2.5, std::numbers::pi / 2.0}).ok());
  ASSERT_TRUE(file.commit().ok());
  EXPECT_EQ(read_text(folder.path() / "a.tum"),
            "1.000000 1.000000 -2.500000 0 0 0 0.000000000 1.000000000\n"
            "1.025000 1.250000 -2.500000 0 0 0 0.707106781 0.707106781\n");
}

RC_GTEST_PROP(TrajectoryFileTest, RoundTrips, ()) {
  const auto entries = *rc::gen::container<std::vector<std::tuple<std::int64_t, int, int, int>>>(
      rc::gen::tuple(rc::gen::arbitrary<std::int64_t>(), rc::gen::inRange(-2'000'000'000, 2'000'000'000),
                     rc::gen::inRange(-2'000'000'000, 2'000'000'000), rc::gen::inRange(-100'000, 100'000)));
  const ScratchFolder folder;
  TrajectoryFile file(folder.path() / "a.tum");
  for (const auto& [stamp_us, x, y, yaw] : entries) {
    RC_ASSERT(file.add(stamp_us, {x * 1e-6, y * 1e-6, yaw * 1e-3}).ok());
  }
  RC_ASSERT(file.commit().ok());
  const auto read = read_tum(folder.path() / "a.tum");
  RC_ASSERT(read.has_value());
  RC_ASSERT(read->size() == entries.size());
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const auto& [stamp_us, x, y, yaw] = entries[i];
    RC_ASSERT((*read)[i].stamp_us == stamp_us);
    RC_ASSERT(std::abs((*read)[i].pose.x - x * 1e-6) < 1e-9);
    RC_ASSERT(std::abs((*read)[i].pose.y - y * 1e-6) < 1e-9);
    RC_ASSERT(std::abs(wrap_angle((*read)[i].pose.yaw - yaw * 1e-3)) < 1e-8);
  }
}

TEST(TrajectoryFileTest, ManyLinesArriveInOrder) {
  const ScratchFolder folder;
  constexpr std::int64_t kLines = 60'000;  // dozens of the writer's pieces
  TrajectoryFile file(folder.path() / "a.tum");
  for (std::int64_t i = 0; i < kLines; ++i) ASSERT_TRUE(file.add(25000 * i, {static_cast<double>(i), 0, 0}).ok());
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "a.tum")) << "visible before commit()";
  ASSERT_TRUE(file.commit().ok());
  const auto read = read_tum(folder.path() / "a.tum");
  ASSERT_TRUE(read.has_value());
  ASSERT_EQ(read->size(), static_cast<std::size_t>(kLines));
  for (std::int64_t i = 0; i < kLines; ++i) {
    ASSERT_EQ((*read)[static_cast<std::size_t>(i)], (StampedPose{25000 * i, {static_cast<double>(i), 0, 0}}));
  }
}

TEST(TrajectoryFileTest, WithoutCommitNothingIsLeft) {
  const ScratchFolder folder;
  {
    TrajectoryFile file(folder.path() / "a.tum");
    ASSERT_TRUE(file.add(0, {}).ok());
  }
  EXPECT_EQ(folder.entries(), 0U);
}

TEST(TrajectoryFileTest, RefusesAPoseThatIsNotFiniteAndGoesOn) {
  const ScratchFolder folder;
  TrajectoryFile file(folder.path() / "a.tum");
  const Status status = file.add(7, {std::numeric_limits<double>::quiet_NaN(), 0, 0});
  EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
  EXPECT_THAT(status.message(), HasSubstr("0.000007"));
  EXPECT_TRUE(file.add(8, {}).ok());
  ASSERT_TRUE(file.commit().ok());
  EXPECT_EQ(read_tum(folder.path() / "a.tum")->size(), 1U);
}

TEST(TrajectoryFileTest, AMissingFolderIsAnErrorWithThePath) {
  const ScratchFolder folder;
  const std::filesystem::path path = folder.path() / "missing" / "a.tum";
  TrajectoryFile file(path);
  (void)file.add(0, {});
  const Status status = file.commit();
  EXPECT_EQ(status.code(), StatusCode::kIo);
  EXPECT_THAT(status.message(), HasSubstr(path.string()));
}

TEST(ReadTumTest, TakesWhatOtherToolsWrite) {
  const auto read = parse(
      "# timestamp tx ty tz qx qy qz qw\n"
      "\n"
      "1305031102.1753 1.5 2 0.1 0 0 0 1\r\n"
      "1.305031102175304e+09 -1e-3 2 0 0 0 -1 0\n"
      "12\t0 0 0 0 0 0 -1\n");
  ASSERT_TRUE(read.has_value()) << read.error().message();
  ASSERT_EQ(read->size(), 3U);
  EXPECT_EQ((*read)[0], (StampedPose{1305031102175300, {1.5, 2.0, 0.0}}));
  EXPECT_EQ((*read)[1].stamp_us, 1305031102175304);
  EXPECT_DOUBLE_EQ(std::abs((*read)[1].pose.yaw), std::numbers::pi);
  EXPECT_EQ((*read)[2].stamp_us, 12000000);
  EXPECT_NEAR((*read)[2].pose.yaw, 0.0, 1e-15);
}

TEST(ReadTumTest, DamageIsAnErrorWithItsLine) {
  const std::string good = "1.0 0 0 0 0 0 0 1\n";
  for (const std::string bad :
       {"1.0 0 0 0 0 0 0\n", "1.0 0 0 0 0 0 0 1 2\n", "x 0 0 0 0 0 0 1\n", "1.0 0 nan 0 0 0 0 1\n",
        ".5 0 0 0 0 0 0 1\n", "1.0 0 0 0 0 0 0 0\n", "1.-5 0 0 0 0 0 0 1\n", "9223372036855 0 0 0 0 0 0 1\n",
        "1e300 0 0 0 0 0 0 1\n", "1.0 0 0 0 0 0 0 1"}) {
    const auto read = parse(good + bad);
    ASSERT_FALSE(read.has_value()) << bad;
    EXPECT_EQ(read.error().code(), StatusCode::kCorrupt);
    EXPECT_THAT(read.error().message(), HasSubstr("test.tum:2: ")) << bad;
  }
  EXPECT_FALSE(parse(good + std::string(100'000, '1') + "\n").has_value()) << "a line without bounds";
  EXPECT_EQ(read_tum(std::filesystem::path("no/such/file.tum")).error().code(), StatusCode::kNotFound);
}

RC_GTEST_PROP(ReadTumTest, NeverFallsOverRandomBytes, (const std::string& bytes)) {
  (void)parse(bytes);
  (void)parse("1.0 0 0 0 0 0 0 1\n" + bytes + "\n");
}

}  // namespace
}  // namespace submapd
