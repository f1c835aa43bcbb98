// Properties: what the encoder writes the parser reads, however it is cut; damage never gets past the checks unseen.
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <string>
#include <vector>

#include "driver/scip/encode.hpp"
#include "driver/scip/parser.hpp"
#include "tests/support/scip_recorder.hpp"

namespace submapd::driver::scip::test {
namespace {

using ::submapd::test::parse_chunks;
using ::submapd::test::parse_whole;
using ::submapd::test::ScipRecorder;

ScanRequest any_request() {
  ScanRequest request;
  request.mode = *rc::gen::element('M', 'N', 'G', 'H');
  request.data = *rc::gen::element('D', 'S', 'E');
  request.microseconds = request.streams() && *rc::gen::arbitrary<bool>();
  request.first_step = *rc::gen::inRange(0, 1081);
  request.last_step = *rc::gen::inRange(request.first_step, 1081);
  request.cluster = *rc::gen::inRange(0, 100);
  request.interval = request.streams() ? *rc::gen::inRange(0, 10) : 0;
  request.number = request.streams() ? *rc::gen::inRange(0, 100) : 0;
  return request;
}

struct Sample {
  std::uint64_t time = 0;
  std::vector<std::uint8_t> counts;
  std::vector<std::uint32_t> ranges_mm;
  std::vector<std::uint32_t> intensities;
};

Sample any_sample(const ScanRequest& request) {
  Sample sample;
  sample.time = *rc::gen::inRange<std::uint64_t>(0, request.microseconds ? std::uint64_t{1} << 62 : 1U << 24);
  std::size_t echoes = request.beams();
  if (request.multi_echo()) {
    sample.counts =
        *rc::gen::container<std::vector<std::uint8_t>>(request.beams(), rc::gen::inRange<std::uint8_t>(1, 4));
    echoes = 0;
    for (const std::uint8_t count : sample.counts) echoes += count;
  }
  const std::uint32_t end = 1U << (6 * request.range_characters());
  sample.ranges_mm = *rc::gen::container<std::vector<std::uint32_t>>(echoes, rc::gen::inRange<std::uint32_t>(0, end));
  if (request.intensities()) {
    sample.intensities =
        *rc::gen::container<std::vector<std::uint32_t>>(echoes, rc::gen::inRange<std::uint32_t>(0, end));
  }
  return sample;
}

std::string encoded(const Command& command, const Sample& sample) {
  const ScanRequest& request = command.request();
  std::string out;
  if (request.streams()) append_status(out, command.text(), "00");
  append_scan(out, {.echo = command.text(),
                    .status = request.streams() ? "99" : "00",
                    .time = sample.time,
                    .time_characters = request.microseconds ? kMicrosecondTimeCharacters : kTimeCharacters,
                    .value_characters = request.range_characters(),
                    .ranges_mm = sample.ranges_mm,
                    .intensities = sample.intensities,
                    .echo_counts = sample.counts});
  return out;
}

class Keep final : public Listener {
 public:
  explicit Keep(const Sample& sample) : sample_(sample) {}
  int scans = 0;
  void on_scan(const ScanData& scan) noexcept override {
    ++scans;
    EXPECT_EQ(scan.time, sample_.time);
    EXPECT_TRUE(
        std::equal(scan.ranges_mm.begin(), scan.ranges_mm.end(), sample_.ranges_mm.begin(), sample_.ranges_mm.end()));
    EXPECT_TRUE(std::equal(scan.intensities.begin(), scan.intensities.end(), sample_.intensities.begin(),
                           sample_.intensities.end()));
    EXPECT_TRUE(
        std::equal(scan.echo_counts.begin(), scan.echo_counts.end(), sample_.counts.begin(), sample_.counts.end()));
  }
  void on_stale_scan(const ScanData&) noexcept override { ADD_FAILURE(); }
  void on_stream_start(const Frame&) noexcept override {}
  void on_stream_status(const Frame&) noexcept override { ADD_FAILURE(); }
  void on_time(const Frame&, std::uint64_t) noexcept override { ADD_FAILURE(); }
  void on_reply(const Frame&, std::span<const Parameter>) noexcept override { ADD_FAILURE(); }
  void on_fault(const Fault& fault) noexcept override { ADD_FAILURE() << name(fault.fault); }

 private:
  const Sample& sample_;
};

RC_GTEST_PROP(ScipRoundTrip, EveryScanComesBackAsItWasEncoded, ()) {
  const Command command = Command::scan(any_request(), *rc::gen::element("", "a", "0123456789.+@_ x"));
  const Sample sample = any_sample(command.request());
  const std::string rx = encoded(command, sample);
  Parser parser;
  RC_ASSERT(parser.expect(command));
  Keep keep(sample);
  parser.feed(::submapd::test::as_bytes(rx), 0, keep);
  parser.end(0, keep);
  RC_ASSERT(keep.scans == 1);
}

RC_GTEST_PROP(ScipRoundTrip, ACommandIsReadAsItWasWritten, ()) {
  const ScanRequest request = any_request();
  const Command written = Command::scan(request, *rc::gen::element("", "q7"));
  const std::optional<Command> read = Command::parse(written.text());
  RC_ASSERT(read.has_value());
  RC_ASSERT(read->request() == request);
  RC_ASSERT(read->kind() == (request.streams() ? CommandKind::kScanStream : CommandKind::kScanOnce));
}

// A stream of replies with damage of every kind that a wire or a queue makes.
std::string damaged_stream(const std::vector<Command>& sent) {
  std::string rx;
  for (const Command& command : sent) {
    if (command.kind() == CommandKind::kScanStream || command.kind() == CommandKind::kScanOnce) {
      rx += encoded(command, any_sample(command.request()));
    } else if (command.kind() == CommandKind::kTime) {
      append_time(rx, command.text(), 4711);
    } else {
      append_status(rx, command.text(), "00");
    }
  }
  const int damages = *rc::gen::inRange(0, 4);
  for (int i = 0; i < damages && !rx.empty(); ++i) {
    const std::size_t at = *rc::gen::inRange<std::size_t>(0, rx.size());
    switch (*rc::gen::inRange(0, 4)) {
      case 0:
        rx[at] = static_cast<char>(*rc::gen::inRange(0, 256));
        break;
      case 1:
        rx.erase(at, 64);
        break;
      case 2:
        rx.insert(at, rx.substr(at, 64));
        break;
      default:
        rx.insert(at, "\n");
        break;
    }
  }
  return rx;
}

RC_GTEST_PROP(ScipDamage, TheEventsDoNotDependOnTheChunks, ()) {
  ScanRequest request = any_request();
  request.last_step = std::min(request.last_step, request.first_step + 100);
  const std::vector<Command> sent = {*Command::parse("VV"), Command::scan(request), *Command::parse("TM1"),
                                     *Command::parse("QT"), Command::scan(request)};
  const std::string rx = damaged_stream(sent);
  const auto sizes =
      *rc::gen::nonEmpty(rc::gen::container<std::vector<std::size_t>>(rc::gen::inRange<std::size_t>(1, 200)));
  std::size_t next = 0;
  const ScipRecorder cut = parse_chunks(sent, rx, [&] { return sizes[next++ % sizes.size()]; });
  RC_ASSERT(cut.events == parse_whole(sent, rx).events);
}

// One changed byte in the data is seen unless it moves the sum by a multiple of 64 within the code's characters; there
// is no such byte.
RC_GTEST_PROP(ScipDamage, OneChangedDataByteIsAlwaysSeen, ()) {
  const Command md = *Command::parse("MD0000010001000");
  const std::string clean = encoded(md, any_sample(md.request()));
  std::string rx = clean;
  const std::size_t data = md.text().size() * 2 + 2 + 5 + 4 + 6;  // both heads, the time
  const std::size_t at = *rc::gen::inRange(data, rx.size() - 1);
  rx[at] = static_cast<char>(*rc::gen::inRange(0, 256));
  const auto kinds = parse_whole(std::vector<Command>{md}, rx).kinds();
  RC_ASSERT(rx == clean || kinds.at(1).starts_with("fault:"));
}

}  // namespace
}  // namespace submapd::driver::scip::test
