// Any bytes of a sensor, cut in any way: the events must be those of the bytes as a whole.
//
// Input: byte 0 chooses the commands that were sent, byte 1 seeds the chunk sizes, the rest came from the sensor.
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <string_view>
#include <vector>

#include "tests/support/scip_recorder.hpp"

namespace {

using submapd::driver::scip::Command;
using submapd::driver::scip::Parser;

constexpr std::array<std::array<std::string_view, 4>, 8> kSent = {{
    {"VV", "PP", "II", "BM"},
    {"MD0000108001000", "QT", "VV", "MD0000108001000"},
    {"MD0540055901000", "QT", "TM1", "RS"},
    {"ME0540055901000;abc", "MS0540057101003", "GE0540055901", "II"},
    {"ND0540054201000", "HE0540054401", "NE0540054201000", "HD0540054401"},
    {"%MD0540055901000", "%TM1", "TM1;a", "TM2"},
    {"SCIP2.0", "ZZ", "MD1080000001000", "GD0000108101"},
    {"MD0500055901000", "MD0500055901000", "MD0500055904000", "QT"},
}};

void require(bool condition) {
  if (!condition) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 2) return 0;
  std::vector<Command> sent;
  for (const std::string_view text : kSent[data[0] % kSent.size()]) sent.push_back(*Command::parse(text));
  const std::string_view rx(reinterpret_cast<const char*>(data + 2), size - 2);

  const auto whole = submapd::test::parse_whole(sent, rx);
  std::uint32_t random = data[1];
  const std::uint32_t longest = 1U + data[1] % 80U;
  const auto cut = submapd::test::parse_chunks(sent, rx, [&] {
    random = random * 1664525U + 1013904223U;
    return 1U + (random >> 16) % longest;
  });
  require(whole.events == cut.events);
  // No event without a line of its own, so no input makes the parser talk without end; the last is for the end itself.
  const auto lines = static_cast<std::size_t>(std::count(rx.begin(), rx.end(), '\n'));
  require(whole.events.size() <= lines + 1);
  return 0;
}
