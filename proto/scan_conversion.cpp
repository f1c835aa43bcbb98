#include "proto/scan_conversion.hpp"

#include <array>

#include "proto/lcm_message.hpp"
#include "slam/submap/submap_check.hpp"
#include "submapd/intensities_t.hpp"
#include "submapd/scan_t.hpp"

namespace submapd {
namespace {

// LCM knows no unsigned integers.
std::vector<std::int16_t> signed_of(const std::vector<std::uint16_t>& values) {
  return {values.begin(), values.end()};
}
std::vector<std::uint16_t> unsigned_of(const std::vector<std::int16_t>& values) {
  return {values.begin(), values.end()};
}

}  // namespace

std::vector<std::byte> encode_scan(const Scan& scan, const ScanOrigin& origin) {
  scan_t message{};
  message.utime = scan.stamp_us;
  message.device_ms = origin.device_ms;
  message.mono_ns = origin.mono_ns;
  message.seq = static_cast<std::int64_t>(scan.index);
  put_uuid(origin.cart, message.cart);
  put_uuid(origin.run, message.run);
  message.rad0 = scan.geometry.first_angle_rad;
  message.radstep = scan.geometry.angle_step_rad;
  message.sweep_s = scan.geometry.sweep_s;
  message.range_min_m = scan.geometry.range_min_m;
  message.range_max_m = scan.geometry.range_max_m;
  put_pose(scan.geometry.base_from_sensor, message.base_from_sensor);
  message.has_odometry = scan.odometry.has_value() ? 1 : 0;
  put_pose(scan.odometry.value_or(Pose2{}), message.odometry);
  message.nranges = static_cast<std::int32_t>(scan.ranges_mm.size());
  message.range_mm = signed_of(scan.ranges_mm);
  return encode_message(message);
}

Expected<ScanMessage> decode_scan(std::span<const std::byte> bytes) {
  const Expected<scan_t> message = decode_message<scan_t>(bytes, std::array<std::size_t, 1>{2});
  if (!message) return failure(message.error());
  if (message->seq < 0) return failure(StatusCode::kCorrupt, "scan_t: negative sequence number");
  if (message->has_odometry != 0 && message->has_odometry != 1) {
    return failure(StatusCode::kCorrupt, "scan_t: boolean neither 0 nor 1");
  }
  ScanMessage result;
  result.origin = {get_uuid(message->cart), get_uuid(message->run), message->device_ms, message->mono_ns};
  Scan& scan = result.scan;
  scan.stamp_us = message->utime;
  scan.index = static_cast<std::uint64_t>(message->seq);
  scan.geometry = {message->rad0,        message->radstep,     message->sweep_s,
                   message->range_min_m, message->range_max_m, get_pose(message->base_from_sensor)};
  if (message->has_odometry == 1) scan.odometry = get_pose(message->odometry);
  if (!is_sound(scan.geometry)) return failure(StatusCode::kCorrupt, "scan_t: geometry out of range");
  if (!is_sound(get_pose(message->odometry))) return failure(StatusCode::kCorrupt, "scan_t: odometry out of range");
  if (message->range_mm.size() > kMaxBeams) return failure(StatusCode::kCorrupt, "scan_t: too many beams");
  scan.ranges_mm = unsigned_of(message->range_mm);
  return result;
}

std::vector<std::byte> encode_intensities(const ScanIntensities& intensities, const ScanOrigin& origin) {
  intensities_t message{};
  message.utime = intensities.stamp_us;
  message.seq = static_cast<std::int64_t>(intensities.index);
  put_uuid(origin.cart, message.cart);
  put_uuid(origin.run, message.run);
  message.nvalues = static_cast<std::int32_t>(intensities.values.size());
  message.value = signed_of(intensities.values);
  return encode_message(message);
}

Expected<ScanIntensities> decode_intensities(std::span<const std::byte> bytes) {
  const Expected<intensities_t> message = decode_message<intensities_t>(bytes, std::array<std::size_t, 1>{2});
  if (!message) return failure(message.error());
  if (message->seq < 0) return failure(StatusCode::kCorrupt, "intensities_t: negative sequence number");
  if (message->value.size() > kMaxBeams) return failure(StatusCode::kCorrupt, "intensities_t: too many beams");
  return ScanIntensities{message->utime, static_cast<std::uint64_t>(message->seq), unsigned_of(message->value)};
}

}  // namespace submapd
