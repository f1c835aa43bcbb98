// Parses one line of a CARMEN text log.
//
// Fields are separated by blanks, lengths in metres, angles in radians, times in seconds:
//   FLASER n r1..rn  x y theta  odom_x odom_y odom_theta  ipc_time host logger_time
//   ROBOTLASER1 type start_angle fov step max_range accuracy remission_mode  n r1..rn  m e1..em
//     laser_x laser_y laser_theta  robot_x robot_y robot_theta  tv rv forward_safety side_safety turn_axis
//     ipc_time host logger_time
//   ODOM x y theta tv rv accel ipc_time host logger_time
//   # sweep_s T        (ours) the scans from here on are stamped at their first beam, the last one is T seconds later
// Other comments say nothing, other keywords are well formed but not ours. The stamp is logger_time; the host is a
// word.
//
// FLASER has no angles: the first beam points at -90 deg, the step is 1 deg up to 181 beams, 0.5 deg up to 361, and
// beyond that what fills 180 deg. Locale-independent. Not thread-safe.
#pragma once

#include <string_view>

#include "slam/base/status.hpp"
#include "slam/scan/scan.hpp"

namespace submapd::tools {

enum class CarmenRecord { kNothing, kScan, kOdometry, kOther };

class CarmenLineParser {
 public:
  static constexpr int kMaxBeams = 10000;

  // What the line (without its line feed) is. kScan: `scan` is overwritten but for its index; otherwise its content is
  // unspecified. kCorrupt: the line does not have its keyword's form; the message says what is wrong with it.
  //
  // No return: ranges that are not finite, negative, 0, above 65.535 m, or at the sensor's limit. The limit is the
  // line's max_range, but at most 50 m for SICK scanners (FLASER; ROBOTLASER1 types 0 and 1), whose codes lie there.
  [[nodiscard]] Expected<CarmenRecord> parse(std::string_view line, Scan& scan);

 private:
  Status parse_flaser(std::string_view fields, Scan& scan) const;
  Status parse_robotlaser(std::string_view fields, Scan& scan);
  Status parse_comment(std::string_view text);

  double sweep_s_ = 0.0;
  Pose2 base_from_sensor_;  // of the last ROBOTLASER1 line
};

}  // namespace submapd::tools
