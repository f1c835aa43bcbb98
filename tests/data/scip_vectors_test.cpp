// The parser on the reference's vectors, at every chunk size, and on the bytes of real sensors.
//
// Both lie in the folder "reference" beside SUBMAPD_DATA.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "driver/scip/parser.hpp"
#include "slam/base/random.hpp"
#include "tests/data/data_folder.hpp"
#include "tests/support/scip_recorder.hpp"
#include "tools/scip/scip_json.hpp"

namespace submapd::test {
namespace {

using driver::scip::Command;
using nlohmann::json;

class ScipReference : public DataTest {
 protected:
  [[nodiscard]] std::string read(const std::string& name) const {
    const std::filesystem::path path = data("..") / "reference" / name;
    std::ifstream file(path, std::ios::binary);
    EXPECT_TRUE(file) << path << " cannot be read";
    return {std::istreambuf_iterator<char>(file), {}};
  }
};

struct Vector {
  std::string id;
  std::vector<Command> sent;
  std::string rx;
  json events;
  std::vector<std::string> kinds;
};

// JSON strings are UTF-8; each character stands for one byte.
std::string latin1(const std::string& utf8) {
  std::string bytes;
  for (std::size_t i = 0; i < utf8.size(); ++i) {
    const auto c = static_cast<unsigned char>(utf8[i]);
    if (c < 0x80) {
      bytes.push_back(utf8[i]);
    } else {
      bytes.push_back(static_cast<char>((c & 0x03) << 6 | (static_cast<unsigned char>(utf8[++i]) & 0x3F)));
    }
  }
  return bytes;
}

std::vector<Vector> parse_vectors(const std::string& text) {
  std::vector<Vector> vectors;
  const json file = json::parse(text);
  for (const json& entry : file.at("vectors")) {
    Vector vector{entry.at("id"), {}, latin1(entry.at("rx")), entry.at("events"), entry.at("kinds")};
    EXPECT_EQ(vector.rx.size(), entry.at("rx_len").get<std::size_t>());
    for (const std::string text_sent : entry.at("tx")) vector.sent.push_back(*Command::parse(text_sent));
    vectors.push_back(std::move(vector));
  }
  return vectors;
}

json events_of(const Vector& vector) {
  json events = json::array();
  tools::ScipJson listener([&events](std::string_view line) { events.push_back(json::parse(line)); });
  driver::scip::Parser parser;
  for (const Command& command : vector.sent) EXPECT_TRUE(parser.expect(command));
  parser.feed(as_bytes(vector.rx), 0, listener);
  parser.end(0, listener);
  return events;
}

TEST_F(ScipReference, EveryVectorGivesItsEvents) {
  const std::vector<Vector> vectors = parse_vectors(read("scip_vectors.json"));
  EXPECT_EQ(vectors.size(), 156U);
  for (const Vector& vector : vectors) {
    SCOPED_TRACE(vector.id);
    EXPECT_EQ(events_of(vector), vector.events);
    EXPECT_EQ(parse_whole(vector.sent, vector.rx).kinds(), vector.kinds);
  }
}

TEST_F(ScipReference, NoVectorDependsOnItsChunks) {
  for (const Vector& vector : parse_vectors(read("scip_vectors.json"))) {
    SCOPED_TRACE(vector.id);
    const std::vector<std::string> whole = parse_whole(vector.sent, vector.rx).events;
    for (std::size_t size = 1; size <= 512; ++size) {
      ASSERT_EQ(parse_chunks(vector.sent, vector.rx, [size] { return size; }).events, whole) << "chunks of " << size;
    }
    for (std::uint64_t seed = 1; seed <= 50; ++seed) {
      CounterRandom random(seed, 0, 0);
      const auto size = [&random] { return static_cast<std::size_t>(1 + random.next_u64() % 700); };
      ASSERT_EQ(parse_chunks(vector.sent, vector.rx, size).events, whole) << "random chunks, seed " << seed;
    }
  }
}

// Events of a capture, as kinds; the sent bytes tell the commands.
class Capture {
 public:
  Capture(const std::string& tx, const std::string& rx) {
    std::size_t begin = 0;
    for (std::size_t end = tx.find_first_of("\r\n"); end != tx.npos; end = tx.find_first_of("\r\n", begin)) {
      if (end > begin) sent.push_back(*Command::parse(tx.substr(begin, end - begin)));
      begin = end + 1;
    }
    recorder = parse_whole(sent, rx);
  }
  std::vector<Command> sent;
  ScipRecorder recorder;
};

std::vector<std::string> sum_up(const std::vector<std::string>& kinds) {
  std::vector<std::string> result;
  for (std::size_t i = 0, j = 0; i < kinds.size(); i = j) {
    while (j < kinds.size() && kinds[j] == kinds[i]) ++j;
    result.push_back(kinds[i] + " x" + std::to_string(j - i));
  }
  return result;
}

TEST_F(ScipReference, CaptureOfAUtm30LxHoldsNoFault) {
  const Capture capture(read("captures/utm_30lx.tx.bin"), read("captures/utm_30lx.rx.bin"));
  EXPECT_THAT(sum_up(capture.recorder.kinds()), ::testing::ElementsAre("reply x9", "ack x1", "scan x1"));
  const std::string& scan = capture.recorder.events.back();
  EXPECT_THAT(scan, ::testing::HasSubstr("t=4821609 ranges=45,48,"));
  EXPECT_THAT(scan, ::testing::HasSubstr("intensities=1809,1780,"));
  EXPECT_EQ(std::count(scan.begin(), scan.end(), ','), 2 * 1081);
  EXPECT_THAT(capture.recorder.events[0], ::testing::HasSubstr("SERI=00903971"));
}

TEST_F(ScipReference, CaptureOfAUxm30LxHoldsNoFault) {
  const Capture capture(read("captures/uxm_30lx_e.tx.bin"), read("captures/uxm_30lx_e.rx.bin"));
  EXPECT_THAT(sum_up(capture.recorder.kinds()), ::testing::ElementsAre("reply x5", "time x10", "reply x6", "scan x1"));
  const std::string& scan = capture.recorder.events.back();
  EXPECT_EQ(std::count(scan.begin(), scan.end(), ','), 761);
}

TEST_F(ScipReference, CaptureOfAUrg04LxHoldsNoFault) {
  const Capture capture(read("captures/urg_04lx.tx.bin"), read("captures/urg_04lx.rx.bin"));
  EXPECT_THAT(sum_up(capture.recorder.kinds()), ::testing::ElementsAre("reply x9", "scan x1"));
  const std::string& scan = capture.recorder.events.back();
  EXPECT_EQ(std::count(scan.begin(), scan.end(), ','), 682);
}

// A sensor that begins in SCIP 1.1: its answer to V has no sum and is not taken for SCIP 2.0. The last scan's command
// is not among the recorded ones.
TEST_F(ScipReference, CaptureThatBeginsInScip11GoesOnInScip20) {
  const Capture capture(read("captures/player_urg_04lx_scip11.tx.bin"), read("captures/player_urg_04lx_scip11.rx.bin"));
  EXPECT_THAT(sum_up(capture.recorder.kinds()), ::testing::ElementsAre("fault:bad_status x1", "reply x10", "scan x3",
                                                                       "reply x3", "scan x1", "fault:bad_echo x1"));
  EXPECT_EQ(capture.recorder.events.at(1), "reply SCIP2.0 0");
  EXPECT_EQ(capture.recorder.events.at(10), "reply HS0 0C");
}

}  // namespace
}  // namespace submapd::test
