// LCM event logs: known events, garbage between them, lengths that lie, ends at every byte.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "tests/unit/log/log_bytes.hpp"
#include "tools/log/lcm_reader.hpp"

namespace submapd::tools::test {
namespace {

using ::testing::HasSubstr;

// An event whose header claims other lengths than it has.
std::string lying_event(std::uint32_t channel_bytes, std::uint32_t data_bytes, const std::string& rest) {
  std::string bytes = lcm_event("", "").substr(0, 20);
  put_big_endian(bytes, channel_bytes, 4);
  put_big_endian(bytes, data_bytes, 4);
  return bytes + rest;
}

std::vector<std::int64_t> stamps(const Contents& log) {
  std::vector<std::int64_t> stamps_us;
  for (const auto& scan : log.scans) stamps_us.push_back(scan.stamp_us);
  return stamps_us;
}

TEST(LcmTest, ScansAreDecodedOthersCounted) {
  const auto log =
      read_bytes(lcm_event("POSE", "x") + lcm_event("SCAN", "7") + lcm_event("POSE", "") + lcm_event("SCAN", "8"));
  EXPECT_EQ(stamps(log), (std::vector<std::int64_t>{7, 8}));
  EXPECT_EQ(log.summary.scans, 2U);
  EXPECT_EQ(log.summary.other_records, 2U);
  EXPECT_EQ(log.summary.skipped_records, 0U);
  EXPECT_EQ(log.summary.skipped_bytes, 0U);
}

TEST(LcmTest, RefusedDataIsADamagedRecord) {
  const auto log = read_bytes(lcm_event("SCAN", "bad") + lcm_event("SCAN", "8") + lcm_event("SCAN", "3"));
  EXPECT_EQ(stamps(log), (std::vector<std::int64_t>{8, 3}));
  EXPECT_EQ(log.summary.skipped_records, 1U);
  EXPECT_EQ(log.summary.skipped_bytes, lcm_event("SCAN", "bad").size());
  EXPECT_EQ(log.summary.backward_stamps, 1U);
  EXPECT_EQ(log.summary.problems.at(0), "byte 0: not decimal");
}

TEST(LcmTest, GarbageBetweenEventsIsSkipped) {
  const std::vector<std::string> pieces = {std::string("\xED\xA1\xDA", 3), std::string("\xED\xA1\xDA\x01", 4), "x",
                                           std::string(100'000, '\xED')};
  for (const auto& garbage : pieces) {
    const auto log =
        read_bytes(fmt::format("{0}{1}{0}{2}{0}", garbage, lcm_event("SCAN", "7"), lcm_event("SCAN", "8")));
    EXPECT_EQ(stamps(log), (std::vector<std::int64_t>{7, 8})) << garbage.size();
    EXPECT_EQ(log.summary.skipped_records, 3U) << garbage.size();
    EXPECT_EQ(log.summary.skipped_bytes, 3 * garbage.size());
  }
}

TEST(LcmTest, AbsurdLengthsAreNotBelieved) {
  const std::vector<std::pair<std::uint32_t, std::uint32_t>> lengths = {
      {0, 5},          {64, 5},         {0x7FFFFFFF, 5}, {0xFFFFFFFF, 5},
      {4, 0xFFFFFFFF}, {4, 0x80000000}, {4, 0x7FFFFFFF}, {4, (4U << 20) + 1}};
  for (const auto& [channel_bytes, data_bytes] : lengths) {
    const std::string lie = lying_event(channel_bytes, data_bytes, "SCAN12345");
    const auto log = read_bytes(lcm_event("SCAN", "7") + lie + lcm_event("SCAN", "8"));
    EXPECT_EQ(stamps(log), (std::vector<std::int64_t>{7, 8})) << channel_bytes << " " << data_bytes;
    EXPECT_EQ(log.summary.skipped_records, 1U);
    EXPECT_EQ(log.summary.skipped_bytes, lie.size());
    EXPECT_THAT(log.summary.problems.at(0), HasSubstr(fmt::format("byte {}: ", lcm_event("SCAN", "7").size())));
  }
}

TEST(LcmTest, ALengthWithinTheCapDoesNotSwallowOthers) {
  const std::string next = lcm_event("SCAN", "8") + lcm_event("SCAN", "9");
  // Ends within the next event, and beyond the log's end.
  for (const std::uint32_t data_bytes : {20U, 4000U}) {
    const auto log = read_bytes(lcm_event("SCAN", "7") + lying_event(4, data_bytes, "SCAN5") + next);
    EXPECT_EQ(stamps(log), (std::vector<std::int64_t>{7, 8, 9})) << data_bytes;
    EXPECT_EQ(log.summary.skipped_records, 1U);
  }
}

TEST(LcmTest, LargestEventIsRead) {
  const auto log = read_bytes(lcm_event(std::string(63, 'C'), std::string(LcmReader::kMaxData_bytes, '\x01')) +
                              lcm_event("SCAN", "8"));
  EXPECT_EQ(stamps(log), (std::vector<std::int64_t>{8}));
  EXPECT_EQ(log.summary.skipped_records, 0U);
}

TEST(LcmTest, CutAnywhereCostsOnlyTheLastEvent) {
  const std::string whole = lcm_event("SCAN", "7");
  const std::string text = whole + lcm_event("SCAN", "8");
  for (std::size_t size = whole.size() + 1; size < text.size(); ++size) {
    const auto log = read_bytes(text.substr(0, size));
    EXPECT_EQ(stamps(log), (std::vector<std::int64_t>{7})) << size;
    EXPECT_EQ(log.summary.skipped_records, 1U) << size;
    EXPECT_EQ(log.summary.skipped_bytes, size - whole.size()) << size;
  }
}

TEST(LcmTest, ManyFalseHeadersEndInLinearTime) {
  // Each claims 4 MiB that are not there, so that each makes the reader look as far as it may.
  std::string text = lcm_event("SCAN", "7");
  for (int i = 0; i < 100'000; ++i) text += lying_event(4, 4U << 20, "");
  const auto log = read_bytes(text);
  EXPECT_EQ(log.summary.scans, 1U);
  EXPECT_EQ(log.summary.skipped_records, 100'000U);
}

RC_GTEST_PROP(LcmProperty, EveryByteIsEitherReadOrCounted, ()) {
  const auto stamps_us = *rc::gen::nonEmpty(rc::gen::container<std::vector<int>>(rc::gen::inRange(0, 1000)));
  std::string text;
  std::size_t garbage_bytes = 0;
  for (const int stamp_us : stamps_us) {
    const auto garbage = *rc::gen::container<std::string>(rc::gen::arbitrary<char>());
    text += garbage + lcm_event("SCAN", std::to_string(stamp_us));
    garbage_bytes += garbage.size();
  }
  const auto log = read_bytes(text);
  RC_ASSERT(stamps(log) == std::vector<std::int64_t>(stamps_us.begin(), stamps_us.end()));
  RC_ASSERT(log.summary.skipped_bytes == garbage_bytes);
}

}  // namespace
}  // namespace submapd::tools::test
