// The parser on hand-made streams: each kind of answer, each kind of damage, and the way back after it.
#include "driver/scip/parser.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "driver/scip/encode.hpp"
#include "tests/support/scip_recorder.hpp"

namespace submapd::driver::scip::test {
namespace {

using ::submapd::test::as_bytes;
using ::submapd::test::parse_whole;
using ::submapd::test::ScipRecorder;
using ::testing::ElementsAre;
using Kinds = std::vector<std::string>;

const std::string kMd = "MD0500055901000";  // 60 beams: lines of 64, 64 and 52 characters

std::string scan(std::uint64_t time, std::size_t beams = 60, std::string_view echo = kMd) {
  std::vector<std::uint32_t> ranges_mm(beams);
  for (std::size_t i = 0; i < beams; ++i) ranges_mm[i] = static_cast<std::uint32_t>(900 + 29 * i);
  std::string out;
  append_scan(out, {.echo = echo, .time = time, .ranges_mm = ranges_mm});
  return out;
}

std::string status(std::string_view echo, std::string_view code) {
  std::string out;
  append_status(out, echo, code);
  return out;
}

std::string acknowledgement() {
  return status(kMd, "00");
}

std::vector<Command> commands(const std::vector<std::string>& texts) {
  std::vector<Command> result;
  for (const std::string& text : texts) result.push_back(*Command::parse(text));
  return result;
}

Kinds kinds_of(const std::vector<std::string>& sent, const std::string& rx) {
  return parse_whole(commands(sent), rx).kinds();
}

// Offsets in scan(): after the echo line, the status line, the time line.
const std::size_t kStatusAt = kMd.size() + 1;
const std::size_t kTimeAt = kStatusAt + 4;
const std::size_t kDataAt = kTimeAt + 6;

TEST(ScipParser, AStreamIsAcknowledgedAndGivesItsScans) {
  const ScipRecorder result = parse_whole(commands({kMd}), acknowledgement() + scan(7) + scan(32));
  ASSERT_THAT(result.kinds(), ElementsAre("ack", "scan", "scan"));
  EXPECT_THAT(result.events[1], ::testing::StartsWith("scan " + kMd + " 99 t=7 ranges=900,929,958,"));
}

TEST(ScipParser, TheSensorsParametersComeBackAsTheyWereSent) {
  std::string rx;
  append_parameters(rx, "II", std::vector<Parameter>{{"TIME", "j;o["}, {"STAT", "Sensor works well."}});
  EXPECT_THAT(parse_whole(commands({"II"}), rx).events, ElementsAre("reply II 00 TIME=j;o[ STAT=Sensor works well."));
}

TEST(ScipParser, ASumUpToTheArrowIsAcceptedToo) {
  const std::string body = "SCSP:Initial(2400[rpm])<-Default setting by user";
  std::string rx = "II\n00P\n" + body + ";";
  rx.push_back(checksum("SCSP:Initial(2400[rpm])"));
  rx += "\n\n";
  EXPECT_THAT(kinds_of({"II"}, rx), ElementsAre("reply"));
}

TEST(ScipParser, ASensorOfScip11AnswersWithoutSum) {
  EXPECT_THAT(parse_whole(commands({"SCIP2.0"}), "SCIP2.0\n0\n\n").events, ElementsAre("reply SCIP2.0 0"));
}

TEST(ScipParser, OneFaultForEachDamagedFrameAndTheNextOneIsGood) {
  const std::string good = scan(57);
  const auto damaged = [](std::size_t at, char c) {
    std::string bytes = scan(32);
    bytes[at] = c;
    return bytes;
  };
  const auto without = [](std::size_t at, std::size_t count) { return scan(32).erase(at, count); };
  const struct {
    const char* title;
    std::string bytes;
    const char* fault;
  } cases[] = {
      {"bit 7 of an echo", damaged(1, static_cast<char>('D' | 0x80)), "fault:bad_char"},
      {"another command's echo", scan(32, 60, "ME0500055901000"), "fault:bad_echo"},
      {"status digit", damaged(kStatusAt, '8'), "fault:bad_sum"},
      {"status line missing", without(kStatusAt, 4), "fault:bad_status"},
      {"time character", damaged(kTimeAt + 2, 'x'), "fault:bad_char"},
      {"time sum", damaged(kTimeAt + 4, '0'), "fault:bad_sum"},
      {"time line missing", without(kTimeAt, 6), "fault:bad_line"},
      {"bit 6 of a data character: the sum does not see it", damaged(kDataAt + 10, static_cast<char>(0x30 ^ 0x40)),
       "fault:bad_char"},
      {"sum of the second line", damaged(kDataAt + 66 + 64, 'o'), "fault:bad_sum"},
      {"a whole line lost: all sums are right", without(kDataAt + 66, 66), "fault:bad_count"},
      {"a USB packet lost: the joined line is too long", without(kDataAt + 40, 64), "fault:oversize_line"},
      {"blank line missing", without(scan(32).size() - 1, 1), "fault:missing_terminator"},
      {"a beam too many", scan(32, 61), "fault:bad_count"},
      {"a beam too few", scan(32, 59), "fault:bad_count"},
      {"'&' with one echo a beam", damaged(kDataAt + 9, '&'), "fault:bad_char"},
      {"endless line", std::string(1000, '0') + "\n", "fault:oversize_line"},
      {"text of another program", "AT+CGMI\n\n", "fault:bad_echo"},
  };
  for (const auto& c : cases) {
    SCOPED_TRACE(c.title);
    const ScipRecorder result = parse_whole(commands({kMd}), acknowledgement() + c.bytes + good);
    EXPECT_THAT(result.kinds(), ElementsAre("ack", c.fault, "scan"));
    EXPECT_THAT(result.events.back(), ::testing::HasSubstr("t=57"));
  }
}

TEST(ScipParser, SilenceInsideAFrameIsOneFaultAndALaterEchoIsAccepted) {
  Parser parser;
  parser.expect(*Command::parse(kMd));
  ScipRecorder recorder;
  const std::string cut = acknowledgement() + scan(7).substr(0, 70);
  parser.feed(as_bytes(cut), 0, recorder);
  parser.end(0, recorder);
  parser.end(0, recorder);
  const std::string whole = scan(32);
  parser.feed(as_bytes(whole), 0, recorder);
  EXPECT_THAT(recorder.kinds(), ElementsAre("ack", "fault:truncated", "scan"));
}

TEST(ScipParser, AfterTheStopIsAnsweredOldScansAreStale) {
  EXPECT_THAT(kinds_of({kMd, "QT"}, acknowledgement() + scan(7) + status("QT", "00") + scan(32)),
              ElementsAre("ack", "scan", "reply", "stale_scan"));
}

TEST(ScipParser, AStreamsStatusIsNotAReply) {
  EXPECT_THAT(parse_whole(commands({kMd}), acknowledgement() + status(kMd, "21") + status(kMd, "98")).events,
              ElementsAre("ack " + kMd + " 00", "stream_status " + kMd + " 21", "stream_status " + kMd + " 98"));
  EXPECT_THAT(kinds_of({kMd}, status(kMd, "0L")), ElementsAre("reply"));
}

TEST(ScipParser, EchoesOfABeamAreCountedAndAtMostThree) {
  const std::string echo = "ND0540054201000";
  const std::vector<std::uint32_t> ranges_mm = {1000, 1, 2, 3, 40, 50};
  const auto stream = [&](std::vector<std::uint8_t> counts) {
    std::string rx = status(echo, "00");
    append_scan(rx, {.echo = echo, .time = 7, .ranges_mm = ranges_mm, .echo_counts = counts});
    return rx;
  };
  EXPECT_THAT(parse_whole(commands({echo}), stream({1, 3, 2})).events.back(),
              ::testing::EndsWith("ranges=1000,1,2,3,40,50, intensities= echoes=1,3,2,"));
  EXPECT_THAT(kinds_of({echo}, stream({1, 4, 1})), ElementsAre("ack", "fault:bad_count"));
  EXPECT_THAT(kinds_of({echo}, stream({3, 3})), ElementsAre("ack", "fault:bad_count"));
}

TEST(ScipParser, OnlyWhatWasSentIsAnswered) {
  Parser parser;
  ScipRecorder recorder;
  parser.expect(*Command::parse("VV"));
  parser.forget();
  const std::string late = "VV\n00P\n\n";
  parser.feed(as_bytes(late), 0, recorder);
  EXPECT_THAT(recorder.kinds(), ElementsAre("fault:bad_echo"));
}

TEST(ScipParser, RefusesMoreThanItCanHold) {
  Parser parser;
  EXPECT_FALSE(parser.expect(Command::scan({.last_step = static_cast<int>(Parser::kMaxBeams)})));
  EXPECT_TRUE(parser.expect(Command::scan({.last_step = static_cast<int>(Parser::kMaxBeams) - 1})));
  for (std::size_t i = 1; i < Parser::kMaxPending; ++i) EXPECT_TRUE(parser.expect(*Command::parse("TM1")));
  EXPECT_FALSE(parser.expect(*Command::parse("QT")));
}

TEST(ScipParser, TooManyParametersAreAFaultAndNothingElse) {
  std::vector<Parameter> parameters(Parser::kMaxParameters, {"KEY", std::string_view(kMd)});
  std::string rx;
  append_parameters(rx, "PP", parameters);
  EXPECT_THAT(kinds_of({"PP"}, rx), ElementsAre("reply"));
  parameters.push_back({"ONE", "more"});
  rx.clear();
  append_parameters(rx, "PP", parameters);
  EXPECT_THAT(kinds_of({"PP"}, rx), ElementsAre("fault:bad_param"));
}

// Keeps the arrival times of the last scan.
class Arrivals final : public Listener {
 public:
  std::int64_t first_ns = -1;
  std::int64_t last_ns = -1;
  void on_scan(const ScanData& scan) noexcept override {
    first_ns = scan.frame.first_byte_ns;
    last_ns = scan.frame.last_byte_ns;
  }
  void on_stale_scan(const ScanData&) noexcept override {}
  void on_stream_start(const Frame&) noexcept override {}
  void on_stream_status(const Frame&) noexcept override {}
  void on_time(const Frame&, std::uint64_t) noexcept override {}
  void on_reply(const Frame&, std::span<const Parameter>) noexcept override {}
  void on_fault(const Fault&) noexcept override { ADD_FAILURE(); }
};

TEST(ScipParser, AScanCarriesTheArrivalOfItsFirstAndOfItsLastByte) {
  const std::string bytes = acknowledgement() + scan(7);
  for (std::size_t cut = 1; cut < scan(7).size(); ++cut) {
    Parser parser;
    parser.expect(*Command::parse(kMd));
    Arrivals arrivals;
    const std::size_t begin = acknowledgement().size();
    parser.feed(as_bytes(bytes).first(begin), 10, arrivals);
    parser.feed(as_bytes(bytes).subspan(begin, cut), 20, arrivals);
    parser.feed(as_bytes(bytes).subspan(begin + cut), 30, arrivals);
    ASSERT_EQ(arrivals.first_ns, 20) << cut;
    ASSERT_EQ(arrivals.last_ns, 30) << cut;
  }
}

TEST(ScipStatus, MeansWhatTheManualSaysOfTheCommand) {
  const struct {
    const char* command;
    const char* code;
    StatusMeaning meaning;
  } cases[] = {{"BM", "00", StatusMeaning::kOk},
               {"BM", "02", StatusMeaning::kAlready},
               {"BM", "01", StatusMeaning::kHardwareTrouble},
               {"TM1;a", "04", StatusMeaning::kTimeModeOff},
               {"TM0", "10", StatusMeaning::kDenied},
               {"GD0000108001", "10", StatusMeaning::kLaserOff},
               {"MD0000108001000", "04", StatusMeaning::kBadParameter},
               {"MD0000108001000", "21", StatusMeaning::kPaused},
               {"MD0000108001000", "98", StatusMeaning::kResumed},
               {"%MD0000108001000", "97", StatusMeaning::kHardwareTrouble},
               {"MD0000108001000", "99", StatusMeaning::kData},
               {"CR00", "04", StatusMeaning::kNotSupported},
               {"QT", "0E", StatusMeaning::kNotSupported},
               {"SCIP2.0", "0E", StatusMeaning::kAlready},
               {"SCIP2.0", "0", StatusMeaning::kOk},
               {"QT", "0L", StatusMeaning::kAbnormal},
               {"MD0000108001000", "0M", StatusMeaning::kUnstable},
               {"RB", "01", StatusMeaning::kOk},
               {"QT", "ZZ", StatusMeaning::kUnknown}};
  for (const auto& c : cases) {
    EXPECT_EQ(explain(c.command, ReplyStatus(c.code)).meaning, c.meaning) << c.command << " " << c.code;
    EXPECT_FALSE(explain(c.command, ReplyStatus(c.code)).words.empty());
  }
}

TEST(ScipStatus, HealthIsReadFromTheSensorsWords) {
  EXPECT_EQ(health_of("Sensor works well."), Health::kWorking);
  EXPECT_EQ(health_of("Stable 000 no error."), Health::kWorking);
  EXPECT_EQ(health_of("sensor is working normally"), Health::kWorking);
  EXPECT_EQ(health_of("Trouble!! Error No. =[00->33]"), Health::kTrouble);
  EXPECT_EQ(health_of("failed to synchronize"), Health::kTrouble);
  EXPECT_EQ(health_of("???"), Health::kUnknown);
}

}  // namespace
}  // namespace submapd::driver::scip::test
