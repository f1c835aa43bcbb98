// check_pose_spool() on any bytes: no crash, and never more than is there.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>

#include "slam/output/pose_spool.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto check = submapd::check_pose_spool(std::as_bytes(std::span(data, size)));
  if (check && (check->whole_bytes > size || check->whole_bytes != 16 + 72 * check->records)) std::abort();
  return 0;
}
