#include "tools/log/carmen_line.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

namespace submapd::tools {
namespace {

constexpr double kDegree_rad = std::numbers::pi / 180.0;
constexpr double kSickLimit_m = 50.0;
constexpr double kMaxStorable_m = 65.535;
constexpr double kUrg04Max_m = 5.6;
constexpr double kUrg04Min_m = 0.02;
constexpr double kMaxSweep_s = 10.0;
constexpr double kMaxStamp_s = 9e12;  // in microseconds just within 64 bits
// The poses are printed with six digits or so. An offset this close to the last one is the same mounting.
constexpr double kSameOffset_m = 2e-3;
constexpr double kSameOffset_rad = 1e-4;

constexpr bool is_blank(char c) {
  return c == ' ' || c == '\t' || c == '\r';
}

Status corrupt(std::string what) {
  return {StatusCode::kCorrupt, std::move(what)};
}

// A field as it may be shown in a message, whatever bytes it has.
std::string shown(std::string_view field) {
  constexpr std::size_t kLongest = 24;
  std::string text(field.substr(0, kLongest));
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return field.size() > kLongest ? text + "..." : text;
}

// Goes through the fields of a line from left to right. The first failure stays.
class Fields {
 public:
  explicit Fields(std::string_view text) : rest_(text) {}

  std::string_view word(const char* name) {
    skip_blanks();
    const auto end = std::find_if(rest_.begin(), rest_.end(), is_blank);
    const std::string_view field = rest_.substr(0, static_cast<std::size_t>(end - rest_.begin()));
    if (field.empty()) fail(fmt::format("ends before {}", name));
    rest_.remove_prefix(field.size());
    return field;
  }

  double number(const char* name) {
    skip_blanks();
    const char* const end = rest_.data() + rest_.size();
    double value = 0.0;
    const auto [stop, error] = std::from_chars(rest_.data(), end, value);
    if (error == std::errc::invalid_argument || (stop != end && !is_blank(*stop))) {
      const std::string_view field = word(name);
      if (status_.ok()) fail(fmt::format("{} is not a number: \"{}\"", name, shown(field)));
      return 0.0;
    }
    rest_.remove_prefix(static_cast<std::size_t>(stop - rest_.data()));
    return error == std::errc::result_out_of_range ? std::numeric_limits<double>::infinity() : value;
  }

  // A number of values to follow.
  int count(const char* name, int low) {
    const double value = number(name);
    if (status_.ok() && (value < low || value > CarmenLineParser::kMaxBeams || value != std::floor(value))) {
      fail(fmt::format("{} is {}, not a whole number from {} to {}", name, value, low, CarmenLineParser::kMaxBeams));
    }
    return status_.ok() ? static_cast<int>(value) : 0;
  }

  Pose2 pose(const char* name) {
    const double x = number(name);
    const double y = number(name);
    return {x, y, number(name)};
  }

  void end() {
    skip_blanks();
    if (!rest_.empty()) fail("has more fields than its numbers of values say");
  }

  bool ok() const { return status_.ok(); }
  const Status& status() const { return status_; }

 private:
  void skip_blanks() {
    std::size_t blanks = 0;
    while (blanks < rest_.size() && is_blank(rest_[blanks])) ++blanks;
    rest_.remove_prefix(blanks);
  }

  void fail(std::string what) {
    if (status_.ok()) status_ = corrupt(std::move(what));
    rest_ = {};
  }

  std::string_view rest_;
  Status status_;
};

bool is_finite(const Pose2& pose) {
  return std::isfinite(pose.x) && std::isfinite(pose.y) && std::isfinite(pose.yaw);
}

void read_ranges(Fields& fields, double limit_m, Scan& scan) {
  const int beams = fields.count("the number of ranges", 1);
  scan.ranges_mm.resize(static_cast<std::size_t>(beams));
  for (auto& range_mm : scan.ranges_mm) {
    const double range_m = fields.number("a range");
    if (!fields.ok()) return;
    const bool measured = range_m > 0.0 && range_m < limit_m && range_m <= kMaxStorable_m;  // false for NaN
    range_mm = measured ? static_cast<std::uint16_t>(std::lround(range_m * 1e3)) : kNoReturn_mm;
  }
}

// The three last fields of every record.
double read_stamp(Fields& fields) {
  fields.number("ipc_time");
  fields.word("the host");
  const double stamp_s = fields.number("logger_time");
  fields.end();
  return stamp_s;
}

Status set_stamp(double stamp_s, Scan& scan) {
  if (!(std::abs(stamp_s) < kMaxStamp_s)) return corrupt("logger_time is no time");
  scan.stamp_us = std::llround(stamp_s * 1e6);
  return {};
}

double flaser_step_rad(std::size_t beams) {
  if (beams <= 181) return kDegree_rad;
  if (beams <= 361) return 0.5 * kDegree_rad;
  return std::numbers::pi / static_cast<double>(beams - 1);
}

bool is_keyword(std::string_view word) {
  return std::all_of(word.begin(), word.end(), [](char c) {
    return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_';
  });
}

}  // namespace

Expected<CarmenRecord> CarmenLineParser::parse(std::string_view line, Scan& scan) {
  const auto start = std::find_if_not(line.begin(), line.end(), is_blank);
  line.remove_prefix(static_cast<std::size_t>(start - line.begin()));
  if (line.empty()) return CarmenRecord::kNothing;

  Status status;
  CarmenRecord record = CarmenRecord::kOther;
  const auto end = std::find_if(line.begin(), line.end(), is_blank);
  const std::string_view keyword = line.substr(0, static_cast<std::size_t>(end - line.begin()));
  const std::string_view fields = line.substr(keyword.size());
  if (keyword == "FLASER") {
    record = CarmenRecord::kScan;
    status = parse_flaser(fields, scan);
  } else if (keyword == "ROBOTLASER1") {
    record = CarmenRecord::kScan;
    status = parse_robotlaser(fields, scan);
  } else if (keyword == "ODOM") {
    record = CarmenRecord::kOdometry;
    Fields numbers(fields);
    numbers.pose("the pose");
    numbers.pose("a velocity");
    read_stamp(numbers);
    status = numbers.status();
  } else if (line.front() == '#') {
    record = CarmenRecord::kNothing;
    status = parse_comment(line.substr(1));
  } else if (!is_keyword(keyword)) {
    return failure(StatusCode::kCorrupt, fmt::format("\"{}\" is no keyword", shown(keyword)));
  }
  if (!status.ok()) return failure(status.code(), fmt::format("{} {}", shown(keyword), status.message()));
  return record;
}

Status CarmenLineParser::parse_flaser(std::string_view text, Scan& scan) const {
  Fields fields(text);
  read_ranges(fields, kSickLimit_m, scan);
  fields.pose("the laser's pose");
  const Pose2 odometry = fields.pose("the odometry");
  const double stamp_s = read_stamp(fields);
  if (!fields.ok()) return fields.status();

  scan.geometry = {.first_angle_rad = -90.0 * kDegree_rad,
                   .angle_step_rad = flaser_step_rad(scan.ranges_mm.size()),
                   .sweep_s = sweep_s_,
                   .range_max_m = kSickLimit_m,
                   .base_from_sensor = {}};
  scan.odometry = is_finite(odometry) ? std::optional(odometry) : std::nullopt;
  return set_stamp(stamp_s, scan);
}

Status CarmenLineParser::parse_robotlaser(std::string_view text, Scan& scan) {
  Fields fields(text);
  const double type = fields.number("the laser's type");
  const double first_angle_rad = fields.number("start_angle");
  fields.number("the field of view");
  const double step_rad = fields.number("the angular step");
  double max_range_m = fields.number("max_range");
  fields.number("the accuracy");
  fields.number("the remission mode");
  if (!fields.ok()) return fields.status();
  if (!(max_range_m > 0.0)) return corrupt("max_range is not above 0");
  if (!(std::abs(first_angle_rad) <= 2.0 * std::numbers::pi) || !(std::abs(step_rad) <= std::numbers::pi)) {
    return corrupt("start_angle or the angular step is no angle in radians");
  }
  const bool is_sick = type == 0.0 || type == 1.0;
  max_range_m = std::min(max_range_m, is_sick ? kSickLimit_m : kMaxStorable_m);

  read_ranges(fields, max_range_m, scan);
  const int remissions = fields.count("the number of remissions", 0);
  for (int i = 0; i < remissions && fields.ok(); ++i) fields.number("a remission");
  const Pose2 laser = fields.pose("the laser's pose");
  const Pose2 robot = fields.pose("the robot's pose");
  for (int i = 0; i < 5; ++i) fields.number("a velocity or safety distance");
  const double stamp_s = read_stamp(fields);
  if (!fields.ok()) return fields.status();
  if (step_rad == 0.0 && scan.ranges_mm.size() > 1) return corrupt("the angular step is 0");

  if (is_finite(laser) && is_finite(robot)) {
    const Pose2 offset = between(robot, laser);
    const Pose2 change = between(base_from_sensor_, offset);
    const bool is_same = std::hypot(change.x, change.y) <= kSameOffset_m && std::abs(change.yaw) <= kSameOffset_rad;
    if (!is_same && is_finite(offset)) base_from_sensor_ = offset;
  }
  scan.geometry = {.first_angle_rad = first_angle_rad,
                   .angle_step_rad = step_rad,
                   .sweep_s = sweep_s_,
                   .range_min_m = std::abs(max_range_m - kUrg04Max_m) < 1e-3 ? kUrg04Min_m : ScanGeometry{}.range_min_m,
                   .range_max_m = max_range_m,
                   .base_from_sensor = base_from_sensor_};
  scan.odometry = is_finite(robot) ? std::optional(robot) : std::nullopt;
  return set_stamp(stamp_s, scan);
}

Status CarmenLineParser::parse_comment(std::string_view text) {
  Fields fields(text);
  if (fields.word("a word") != "sweep_s") return {};
  const double sweep_s = fields.number("the sweep's duration");
  fields.end();
  if (!fields.ok()) return fields.status();
  if (!(sweep_s >= 0.0 && sweep_s <= kMaxSweep_s)) {
    return corrupt(fmt::format("sweep_s is {}, not from 0 to {} s", sweep_s, kMaxSweep_s));
  }
  sweep_s_ = sweep_s;
  return {};
}

}  // namespace submapd::tools
