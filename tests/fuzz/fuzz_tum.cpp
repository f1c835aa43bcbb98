// read_tum() on any bytes: no crash, and the stamps it accepts print and read back as themselves.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <sstream>
#include <string>

#include "slam/output/trajectory_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::istringstream in(std::string(reinterpret_cast<const char*>(data), size));
  const auto poses = submapd::read_tum(in, "fuzz");
  if (!poses) return 0;
  for (const submapd::StampedPose& stamped : *poses) {
    if (!std::isfinite(stamped.pose.x) || !std::isfinite(stamped.pose.y) || !std::isfinite(stamped.pose.yaw)) {
      std::abort();
    }
    std::istringstream again(submapd::seconds_text(stamped.stamp_us) + " 0 0 0 0 0 0 1\n");
    const auto back = submapd::read_tum(again, "again");
    if (!back || back->front().stamp_us != stamped.stamp_us) std::abort();
  }
  return 0;
}
