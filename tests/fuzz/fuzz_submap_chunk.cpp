// Messages of any bytes through every decoder of proto: no crash, no absurd allocation, budgets kept.
//
// The input is a row of messages, each with a length in front (u16, little-endian).
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>

#include "proto/graph_conversion.hpp"
#include "proto/lcm_message.hpp"
#include "proto/odometry_conversion.hpp"
#include "proto/scan_conversion.hpp"
#include "proto/submap_chunks.hpp"
#include "submapd/command_t.hpp"
#include "submapd/pose_t.hpp"
#include "submapd/reply_t.hpp"
#include "submapd/trigger_t.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::size_t kLimit = 100'000;
  submapd::ChunkAssembler assembler(
      {}, {}, [](std::uint32_t, const submapd::Sha256&) { return true; }, kLimit);
  submapd::GraphAssembler graphs;
  std::span<const std::byte> input = std::as_bytes(std::span(data, size));
  while (input.size() > 2) {
    const std::size_t announced = static_cast<std::size_t>(input[0]) | static_cast<std::size_t>(input[1]) << 8;
    const std::size_t length = std::min(announced, input.size() - 2);
    const std::span<const std::byte> message = input.subspan(2, length);
    input = input.subspan(2 + length);

    if (const auto complete = assembler.add(message)) {
      if (submapd::sha256_of(complete->raw).value() != complete->hash) std::abort();
    }
    if (assembler.counters().bytes_used > kLimit) std::abort();
    if (submapd::Expected<submapd::GraphPart> part = submapd::decode_graph_part(message)) {
      (void)graphs.add(std::move(*part));
    }
    if (const auto scan = submapd::decode_scan(message)) {
      if (submapd::encode_scan(scan->scan, scan->origin).size() != message.size()) std::abort();
    }
    if (const auto intensities = submapd::decode_intensities(message)) {
      if (submapd::encode_intensities(*intensities, {}).size() != message.size()) std::abort();
    }
    (void)submapd::decode_with_text<submapd::command_t>(message);
    (void)submapd::decode_with_text<submapd::reply_t>(message);
    (void)submapd::decode_with_text<submapd::trigger_t>(message);
    (void)submapd::decode_message<submapd::pose_t>(message);
    (void)submapd::decode_health(message);
    (void)submapd::decode_odometry(message);
  }
  return 0;
}
