// Opening logs: the kind by content, packed logs whole and cut, and files that are no logs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "slam/base/random.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/unit/log/log_bytes.hpp"
#include "tools/log/carmen_reader.hpp"

namespace submapd::tools::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::SizeIs;

std::string noise(std::size_t size_bytes) {
  CounterRandom random(1, 2, 3);
  std::string bytes(size_bytes, '\0');
  for (auto& byte : bytes) byte = static_cast<char>(random.next_u64());
  return bytes;
}

// Lines that do not pack well, so that a cut falls within the data.
std::string long_log() {
  CounterRandom random(4, 5, 6);
  std::string text;
  for (int i = 0; i < 200; ++i) {
    std::vector<std::string> ranges;
    for (int beam = 0; beam < 181; ++beam) ranges.push_back(fmt::format("{:.3f}", random.uniform(0.5, 20.0)));
    text += flaser(ranges, fmt::format("0 0 0 0 0 0 {0} h {0}", i));
  }
  return text;
}

class OpenLogTest : public ::testing::Test {
 protected:
  std::string write(const std::string& name, const std::string& bytes) const {
    const auto path = folder_ / name;
    std::ofstream(path, std::ios::binary) << bytes;
    return path.string();
  }

  const TemporaryFolder temporary_;
  const std::filesystem::path folder_ = temporary_.path();
};

TEST_F(OpenLogTest, KindIsToldByContentAndNotByName) {
  const std::string text = plain_flaser(3, 1.0) + plain_flaser(3, 2.0);
  const std::string events = lcm_event("SCAN", "7") + lcm_event("SCAN", "8");
  for (const auto& log : {text, events}) {
    for (const auto& bytes : {log, gzipped(log), xzipped(log)}) {
      const auto contents = read_all(open_log(write("log.txt", bytes), decode_double));
      EXPECT_TRUE(contents.status.ok()) << contents.status.message();
      EXPECT_THAT(contents.scans, SizeIs(2));
    }
  }
}

TEST_F(OpenLogTest, PackedLogsOfManyWindowsReadAsPlainOnes) {
  const std::string text = long_log();
  const auto plain = read_bytes(text);
  ASSERT_THAT(plain.scans, SizeIs(200));
  for (const auto& bytes : {gzipped(text), xzipped(text)}) {
    const auto packed = read_bytes(bytes);
    ASSERT_THAT(packed.scans, SizeIs(200));
    for (std::size_t i = 0; i < 200; ++i) EXPECT_EQ(packed.scans[i].ranges_mm, plain.scans[i].ranges_mm);
    EXPECT_FALSE(packed.summary.unreadable_tail);
  }
}

TEST_F(OpenLogTest, ConcatenatedMembersAreOneLog) {
  const std::string line = plain_flaser(3);
  EXPECT_THAT(read_bytes(gzipped(line) + gzipped(line)).scans, SizeIs(2));
  EXPECT_THAT(read_bytes(xzipped(line) + xzipped(line)).scans, SizeIs(2));
}

TEST_F(OpenLogTest, CutPackedLogYieldsItsFrontAndAProblem) {
  const std::string text = long_log();
  for (const auto& whole : {gzipped(text), xzipped(text)}) {
    const auto log = read_bytes(whole.substr(0, whole.size() / 2));
    ASSERT_TRUE(log.status.ok()) << log.status.message();
    EXPECT_GT(log.scans.size(), 50U);
    EXPECT_LT(log.scans.size(), 150U);
    EXPECT_EQ(log.scans.back().stamp_us, 1'000'000 * static_cast<std::int64_t>(log.scans.size() - 1));
    EXPECT_TRUE(log.summary.unreadable_tail);
    EXPECT_LE(log.summary.skipped_records, 1U);
    EXPECT_THAT(log.summary.problems.back(), HasSubstr("cut short"));
  }
}

TEST_F(OpenLogTest, CutByTheLastByteIsNoticed) {
  const std::string text = plain_flaser(3) + plain_flaser(3);
  for (const auto& whole : {gzipped(text), xzipped(text)}) {
    const auto log = read_bytes(whole.substr(0, whole.size() - 1));
    EXPECT_THAT(log.scans, SizeIs(2));
    EXPECT_TRUE(log.summary.unreadable_tail);
  }
}

TEST_F(OpenLogTest, DamagedPackedLogYieldsItsFrontAndAProblem) {
  const std::string text = long_log();
  for (auto bytes : {gzipped(text), xzipped(text)}) {
    bytes.replace(bytes.size() / 2, 1000, std::string(1000, '\xFF'));
    const auto log = read_bytes(bytes);
    ASSERT_TRUE(log.status.ok()) << log.status.message();
    EXPECT_GT(log.scans.size(), 50U);
    EXPECT_LT(log.scans.size(), 200U);
    EXPECT_TRUE(log.summary.unreadable_tail);
  }
}

TEST_F(OpenLogTest, ProgressGoesFromZeroToOne) {
  std::string text;
  for (int i = 0; i < 3; ++i) text += long_log();
  for (const auto& bytes : {text, gzipped(text), xzipped(text)}) {
    auto reader = open_log(write("log", bytes), decode_double);
    ASSERT_TRUE(reader.has_value());
    double last = (*reader)->progress();
    EXPECT_LT(last, 0.9);
    for (auto scan = (*reader)->next(); scan && scan->has_value(); scan = (*reader)->next()) {
      EXPECT_GE((*reader)->progress(), last);
      last = (*reader)->progress();
    }
    EXPECT_EQ((*reader)->progress(), 1.0);
  }
}

TEST_F(OpenLogTest, PipesCanBeRead) {
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  const std::string text = plain_flaser(3) + plain_flaser(3);
  ASSERT_EQ(::write(ends[1], text.data(), text.size()), static_cast<ssize_t>(text.size()));
  ::close(ends[1]);
  const auto log = read_all(open_log(fmt::format("/proc/self/fd/{}", ends[0]), decode_double));
  ::close(ends[0]);
  EXPECT_TRUE(log.status.ok()) << log.status.message();
  EXPECT_THAT(log.scans, SizeIs(2));
}

TEST_F(OpenLogTest, MissingFileIsNotFound) {
  const auto log = open_log((folder_ / "none.clf").string(), decode_double);
  ASSERT_FALSE(log.has_value());
  EXPECT_EQ(log.error().code(), StatusCode::kNotFound);
  EXPECT_THAT(log.error().message(), AllOf(HasSubstr("none.clf"), HasSubstr("check the path")));
}

TEST_F(OpenLogTest, FolderIsAnInvalidArgument) {
  const auto log = open_log(folder_.string(), decode_double);
  ASSERT_FALSE(log.has_value());
  EXPECT_EQ(log.error().code(), StatusCode::kInvalidArgument);
  EXPECT_THAT(log.error().message(), HasSubstr("folder"));
}

TEST_F(OpenLogTest, UnreadableFileHasTheSystemsReason) {
  const std::string path = write("secret.clf", plain_flaser(3));
  ASSERT_EQ(::chmod(path.c_str(), 0), 0);
  if (::geteuid() == 0) GTEST_SKIP() << "root may read everything";
  const auto log = open_log(path, decode_double);
  ASSERT_FALSE(log.has_value());
  EXPECT_EQ(log.error().code(), StatusCode::kIo);
  EXPECT_THAT(log.error().message(), HasSubstr("ermission"));
}

TEST_F(OpenLogTest, WhatHoldsNoScanIsRefused) {
  const std::string truncated_early = gzipped(long_log()).substr(0, 12);
  const std::vector<std::string> others = {"",
                                           "\n",
                                           "# only a comment\n",
                                           "ODOM 0 0 0 0 0 0 1 odom 1\n",
                                           "FLASER 3 1 1\n",
                                           "<html><body>not found</body></html>\n",
                                           noise(100'000),
                                           std::string(100'000, '\0'),
                                           gzipped(""),
                                           gzipped(noise(100'000)),
                                           xzipped("# empty\n"),
                                           truncated_early,
                                           lcm_event("POSE", "1"),
                                           lcm_event("SCAN", "bad")};
  for (const auto& bytes : others) {
    const std::string path = write("other.bin", bytes);
    const auto log = open_log(path, decode_double);
    ASSERT_FALSE(log.has_value()) << bytes.substr(0, 40);
    EXPECT_EQ(log.error().code(), StatusCode::kInvalidArgument) << log.error().message();
    EXPECT_THAT(log.error().message(), AllOf(HasSubstr(path), HasSubstr("holds no laser scan"), HasSubstr("CARMEN")));
  }
}

// Zeros without end, in CARMEN's or LCM's disguise.
class EndlessSource final : public ByteSource {
 public:
  explicit EndlessSource(std::string front) : front_(std::move(front)) {}
  Expected<std::size_t> read(std::span<std::byte> into) override {
    const std::size_t count = std::min(into.size(), front_.size());
    std::fill(into.begin(), into.end(), std::byte{0});
    for (std::size_t i = 0; i < count; ++i) into[i] = static_cast<std::byte>(front_[i]);
    front_.erase(0, count);
    return into.size();
  }
  double progress(std::size_t /*unused_bytes*/) const override { return 0.0; }

 private:
  std::string front_;
};

TEST_F(OpenLogTest, EndlessJunkIsGivenUp) {
  for (const std::string front : {"", "\n\n", "\xED\xA1\xDA\x01"}) {
    const auto log = open_log(std::make_unique<EndlessSource>(front), "endless", decode_double);
    ASSERT_FALSE(log.has_value());
    EXPECT_EQ(log.error().code(), StatusCode::kInvalidArgument);
  }
}

// Refuses to go on after its front, as a disk may.
class FailingSource final : public ByteSource {
 public:
  explicit FailingSource(std::string front) : front_(std::move(front)) {}
  Expected<std::size_t> read(std::span<std::byte> into) override {
    if (front_.empty()) return failure(StatusCode::kIo, "disk: Input/output error");
    const std::size_t count = std::min(into.size(), front_.size());
    for (std::size_t i = 0; i < count; ++i) into[i] = static_cast<std::byte>(front_[i]);
    front_.erase(0, count);
    return count;
  }
  double progress(std::size_t /*unused_bytes*/) const override { return 0.0; }

 private:
  std::string front_;
};

TEST_F(OpenLogTest, FailingDiskIsAnErrorAfterWhatWasRead) {
  const std::string text = long_log();
  for (const auto& bytes : {text, gzipped(text).substr(0, 20'000)}) {
    const auto log = read_all(open_log(std::make_unique<FailingSource>(bytes), "disk", decode_double));
    EXPECT_FALSE(log.scans.empty());
    EXPECT_EQ(log.status.code(), StatusCode::kIo) << log.status.message();
    EXPECT_THAT(log.status.message(), HasSubstr("Input/output error"));
  }
}

}  // namespace
}  // namespace submapd::tools::test
