#include "proto/odometry_conversion.hpp"

#include "proto/lcm_message.hpp"
#include "slam/submap/submap_check.hpp"
#include "submapd/odometry_t.hpp"

namespace submapd {

Expected<OdometryMessage> decode_odometry(std::span<const std::byte> bytes) {
  const Expected<odometry_t> message = decode_message<odometry_t>(bytes);
  if (!message) return failure(message.error());
  if (message->utime < 0) return failure(StatusCode::kCorrupt, "odometry_t: before 1970");
  const Pose2 pose = get_pose(message->odom_from_base);
  if (!is_sound(pose)) return failure(StatusCode::kCorrupt, "odometry_t: pose not finite or too far");
  return OdometryMessage{message->utime, get_uuid(message->cart), pose};
}

}  // namespace submapd
