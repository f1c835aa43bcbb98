// Known bytes of the specification and of real sensors pin the encoder.
#include "driver/scip/encode.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "driver/scip/command.hpp"

namespace submapd::driver::scip::test {
namespace {

std::string encoded(std::uint64_t value, std::size_t characters) {
  std::string out;
  encode(value, characters, [&out](char c) { out.push_back(c); });
  return out;
}

TEST(ScipCode, NumbersAreThoseOfTheSpecification) {
  EXPECT_EQ(encoded(1234, 2), "CB");
  EXPECT_EQ(encoded(5432, 3), "1Dh");
  EXPECT_EQ(encoded(16'777'215, 4), "oooo");
  EXPECT_EQ(decode("CB"), 1234U);
  EXPECT_EQ(decode("1Dh"), 5432U);
  EXPECT_EQ(decode("m2@0"), 16'000'000U);
  EXPECT_EQ(decode("BI9Y"), 4'821'609U);  // a real UTM-30LX
  EXPECT_EQ(encoded(123'456'789'012, kMicrosecondTimeCharacters).size(), 11U);
  EXPECT_EQ(decode(encoded(123'456'789'012, kMicrosecondTimeCharacters)), 123'456'789'012U);
}

TEST(ScipCode, SumsAreThoseOfRealSensors) {
  for (const auto& [text, sum] : std::vector<std::pair<std::string_view, char>>{{"00", 'P'},
                                                                                {"99", 'b'},
                                                                                {"0E", 'e'},
                                                                                {"02", 'R'},
                                                                                {"04", 'T'},
                                                                                {"0C", 'c'},
                                                                                {"PROT:SCIP 2.0", 'N'},
                                                                                {"DMIN:23", '7'},
                                                                                {"AMAX:1080", 'Z'},
                                                                                {"MESM:CLASSIC", '^'},
                                                                                {"BI9Y", 'M'},
                                                                                {"<Sfk", 'P'}}) {
    EXPECT_EQ(checksum(text), sum) << text;
  }
}

TEST(ScipCode, OnlyTheSixtyFourCodeCharactersCodeValues) {
  int codes = 0;
  for (int c = 0; c < 256; ++c) codes += is_code(static_cast<char>(c)) ? 1 : 0;
  EXPECT_EQ(codes, 64);
  EXPECT_TRUE(is_code('0'));
  EXPECT_TRUE(is_code('o'));
  EXPECT_FALSE(is_code('/'));
  EXPECT_FALSE(is_code('p'));
}

TEST(ScipCommand, ScanCommandsAreWrittenAsTheSensorReadsThem) {
  EXPECT_EQ(Command::scan({}).text(), "MD0000108001000");
  EXPECT_EQ(Command::scan({.data = 'E', .number = 1}, "a3f").text(), "ME0000108001001;a3f");
  EXPECT_EQ(Command::scan({.mode = 'G', .first_step = 44, .last_step = 725, .cluster = 1}).text(), "GD0044072501");
  EXPECT_EQ(Command::scan({.microseconds = true, .mode = 'N', .interval = 9}).text(), "%ND0000108001900");
}

TEST(ScipCommand, KindsAndGeometryAreReadFromTheText) {
  EXPECT_EQ(Command::parse("VV")->kind(), CommandKind::kParameters);
  EXPECT_EQ(Command::parse("TM1;x")->kind(), CommandKind::kTime);
  EXPECT_EQ(Command::parse("%TM1")->kind(), CommandKind::kTime);
  EXPECT_EQ(Command::parse("TM0")->kind(), CommandKind::kOther);
  EXPECT_EQ(Command::parse("GD0044072501")->kind(), CommandKind::kScanOnce);
  EXPECT_EQ(Command::parse("MD00001080010")->kind(), CommandKind::kOther);  // too short for a stream
  EXPECT_EQ(Command::parse("MD000010800100x")->kind(), CommandKind::kOther);
  EXPECT_EQ(Command::parse("%GD0044072501")->kind(), CommandKind::kOther);
  EXPECT_EQ(Command::parse("MD0000108001000;0123456789abcdefg")->kind(), CommandKind::kOther);  // string over 16
  const Command md = *Command::parse("MD0540055904203;q");
  ASSERT_EQ(md.kind(), CommandKind::kScanStream);
  EXPECT_EQ(md.request().beams(), 5U);
  EXPECT_EQ(md.request().interval, 2);
  EXPECT_EQ(md.request().number, 3);
  EXPECT_EQ(Command::parse("MD1080000001000")->request().beams(), 0U);
  EXPECT_FALSE(Command::parse(""));
  EXPECT_FALSE(Command::parse("V\x80"));
  EXPECT_FALSE(Command::parse(std::string(Command::kCapacity + 1, 'x')));
}

TEST(ScipCommand, AStreamIsTheSameWhateverItsCount) {
  const Command md = *Command::parse("MD0000108001003");
  EXPECT_TRUE(md.same_stream(*Command::parse("MD0000108001001")));
  EXPECT_FALSE(md.same_stream(*Command::parse("ME0000108001003")));
  EXPECT_FALSE(md.same_stream(*Command::parse("MD0000108001103")));
  EXPECT_FALSE(md.same_stream(*Command::parse("MD0000108001003;a")));
  EXPECT_FALSE(md.same_stream(*Command::parse("%MD0000108001003")));
}

TEST(ScipEncode, RepliesHaveTheBytesOfTheVectors) {
  std::string out;
  append_status(out, "BM", "02");
  append_time(out, "TM1", 4'821'609);
  append_parameters(out, "VV", std::array<Parameter, 2>{{{"PROT", "SCIP 2.0"}, {"SERI", "00123456"}}});
  EXPECT_EQ(out, "BM\n02R\n\nTM1\n00P\nBI9YM\n\nVV\n00P\nPROT:SCIP 2.0;N\nSERI:00123456;2\n\n");
}

TEST(ScipEncode, AScanBeginsLikeTheRealOne) {
  std::string out;
  const std::array<std::uint32_t, 2> ranges_mm{45, 48};
  const std::array<std::uint32_t, 2> intensities{1809, 1780};
  append_scan(out, {.echo = "ME0000000101100", .time = 4'821'609, .ranges_mm = ranges_mm, .intensities = intensities});
  EXPECT_THAT(out, ::testing::StartsWith("ME0000000101100\n99b\nBI9YM\n00]0LA00`0Kd"));
  EXPECT_THAT(out, ::testing::EndsWith("\n\n"));
}

TEST(ScipEncode, EchoesAreSeparatedByAmpersands) {
  std::string out;
  const std::array<std::uint32_t, 4> ranges_mm{1000, 1, 2, 5000};
  const std::array<std::uint8_t, 3> counts{1, 2, 1};
  append_scan(out, {.echo = "HD0540054201", .status = "00", .time = 7, .ranges_mm = ranges_mm, .echo_counts = counts});
  EXPECT_EQ(out.substr(0, out.size() - 3), "HD0540054201\n00P\n00077\n0?X001&0021>8");
}

TEST(ScipEncode, FullScansHaveTheirSizesOnTheWire) {
  const std::vector<std::uint32_t> values(1081, 1000);
  std::string md;
  append_scan(md, {.echo = "MD0000108001000", .ranges_mm = values});
  EXPECT_EQ(md.size(), 3372U);
  EXPECT_EQ(md.size(), scan_bytes(15, 3 * 1081));
  std::string me;
  append_scan(me, {.echo = "ME0000108001000", .ranges_mm = values, .intensities = values});
  EXPECT_EQ(me.size(), 6717U);
  std::string ms;  // 32 values of 2 characters fill one line: no empty line follows
  append_scan(ms, {.echo = "MS0540057101000", .value_characters = 2, .ranges_mm = std::span(values).first(32)});
  EXPECT_EQ(ms.size(), scan_bytes(15, 64));
  EXPECT_EQ(ms.substr(ms.size() - 67, 2), "?X");  // the line begins 64 characters, sum and two feeds before the end
}

}  // namespace
}  // namespace submapd::driver::scip::test
