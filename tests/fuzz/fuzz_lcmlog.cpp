// Any bytes after an LCM event that makes them an .lcmlog with a scan.
#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "tests/fuzz/read_log.hpp"

namespace submapd::tools::test {
namespace {

// Sync word, number, stamp, lengths 1 and 0, channel "S".
constexpr std::array<std::uint8_t, 29> kScanEvent = {0xED, 0xA1, 0xDA, 0x01, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,  0,
                                                     0,    0,    0,    0,    0, 0, 0, 0, 1, 0, 0, 0, 0, 'S'};

// Channels that start with S carry scans, those with E damaged ones.
Expected<std::optional<Scan>> decode(std::string_view channel, std::span<const std::byte> data) {
  require(!channel.empty() && channel.size() <= 63);
  require(data.size() <= std::size_t{4} << 20);
  if (channel.front() == 'E') return failure(StatusCode::kCorrupt, "refused");
  if (channel.front() != 'S') return std::nullopt;
  Scan scan;
  for (const std::byte byte : data) scan.stamp_us += std::to_integer<int>(byte);
  return scan;
}

}  // namespace
}  // namespace submapd::tools::test

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace submapd::tools::test;
  std::vector<std::uint8_t> log(kScanEvent.begin(), kScanEvent.end());
  log.insert(log.end(), data, data + size);
  read_log(std::as_bytes(std::span(log)), decode);
  return 0;
}
