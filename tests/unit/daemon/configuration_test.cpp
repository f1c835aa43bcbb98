// Every key of the file: its default, both ends of its range, and what is said about anything else.
//
// The keys are read from describe_configuration(), so that a key cannot be added without being tested.
#include "daemon/configuration.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/temporary_folder.hpp"

namespace submapd {
namespace {

using testing::HasSubstr;

struct DescribedKey {
  std::string section;
  std::string name;
  std::string rule;   // what is allowed, in words
  std::string value;  // the default
};

std::vector<DescribedKey> described_keys() {
  std::istringstream text(describe_configuration());
  std::vector<DescribedKey> keys;
  std::string section;
  std::string comment;
  for (std::string line; std::getline(text, line);) {
    if (line.empty()) continue;
    if (line[0] == '[') {
      section = line.substr(1, line.size() - 2);
    } else if (line[0] == '#') {
      comment = line;
    } else {
      const std::size_t equals = line.find(" = ");
      EXPECT_NE(equals, std::string::npos) << line;
      EXPECT_FALSE(comment.empty()) << line << " has no comment";
      keys.push_back(
          {section, line.substr(0, equals), comment.substr(comment.rfind(": ") + 2), line.substr(equals + 3)});
      comment.clear();
    }
  }
  return keys;
}

std::string file_with(const DescribedKey& key, const std::string& value) {
  return fmt::format("[{}]\n{} = {}\n", key.section, key.name, value);
}

struct Range {
  double low = 0.0;
  double high = 0.0;
  bool whole = false;
};

// Reads "a number from 1 to 500 m" or "a whole number from ...".
bool range_of(const DescribedKey& key, Range& range) {
  std::istringstream words(key.rule);
  std::string word;
  words >> word >> word;
  range.whole = word == "whole";
  if (range.whole) words >> word;
  std::string from;
  std::string to;
  return word == "number" && words >> from >> range.low >> to >> range.high && from == "from" && to == "to";
}

std::string number(double value, bool whole) {
  return whole ? fmt::format("{:.0f}", value) : fmt::format("{:#.17g}", value);
}

std::string error_of(const std::string& text) {
  const Expected<Configuration> parsed = parse_configuration(text, "cart.toml");
  if (parsed) return "";
  EXPECT_EQ(parsed.error().code(), StatusCode::kInvalidArgument);
  return parsed.error().message();
}

TEST(ConfigurationTest, NothingGivesTheDefaults) {
  const Expected<Configuration> parsed = parse_configuration("", "cart.toml");
  ASSERT_TRUE(parsed.has_value());
  EXPECT_EQ(parsed->mapper.keyframe_m, MapperOptions{}.keyframe_m);
  EXPECT_EQ(parsed->graph_bytes, Configuration{}.graph_bytes);
}

// Every key at its default is accepted and changes nothing; the fields are compared one by one.
TEST(ConfigurationTest, TheDescriptionParsesBackToTheDefaults) {
  const Expected<Configuration> parsed = parse_configuration(describe_configuration(), "cart.toml");
  ASSERT_TRUE(parsed.has_value()) << parsed.error().message();
  const Configuration defaults;
  const MapperOptions& a = parsed->mapper;
  const MapperOptions& b = defaults.mapper;
  EXPECT_EQ(a.filter, b.filter);
  EXPECT_EQ(a.particles, b.particles);
  EXPECT_EQ(a.max_adaptive_particles, b.max_adaptive_particles);
  EXPECT_EQ(a.seed, b.seed);
  EXPECT_EQ(a.covariance_kappa, b.covariance_kappa);
  EXPECT_EQ(a.keyframe_m, b.keyframe_m);
  EXPECT_EQ(a.keyframe_rad, b.keyframe_rad);
  EXPECT_EQ(a.keyframe_s, b.keyframe_s);
  EXPECT_EQ(a.limits.path_m, b.limits.path_m);
  EXPECT_EQ(a.limits.keyframes, b.limits.keyframes);
  EXPECT_EQ(a.limits.extent_m, b.limits.extent_m);
  EXPECT_EQ(a.limits.heading_rad, b.limits.heading_rad);
  EXPECT_EQ(a.map.cell_m, b.map.cell_m);
  EXPECT_EQ(a.map.free_space.max_range_m, b.map.free_space.max_range_m);
  EXPECT_EQ(a.points.error_code_is_free, b.points.error_code_is_free);
  EXPECT_EQ(a.map.max_blocks, b.map.max_blocks);
  EXPECT_EQ(a.map.max_faces, b.map.max_faces);
  EXPECT_EQ(a.distance_planes, b.distance_planes);
  EXPECT_EQ(a.unwarp, b.unwarp);
  EXPECT_EQ(a.matcher.use_lines, b.matcher.use_lines);
  EXPECT_EQ(parsed->submap_cache_bytes, defaults.submap_cache_bytes);
  EXPECT_EQ(parsed->graph_bytes, defaults.graph_bytes);
  EXPECT_EQ(parsed->map_raster_bytes, defaults.map_raster_bytes);
  EXPECT_EQ(parsed->scanner.roles[0].serial, "");
  EXPECT_EQ(parsed->scanner.roles[1].serial, "");
  EXPECT_EQ(parsed->scanner.roles[0].port, "");
  EXPECT_EQ(parsed->scanner.roles[1].port, "");
  EXPECT_EQ(parsed->scanner.intensity, defaults.scanner.intensity);
  EXPECT_EQ(parsed->scanner.stamp_to_first_beam_us, defaults.scanner.stamp_to_first_beam_us);
  EXPECT_EQ(parsed->daemon.state, defaults.daemon.state);
  EXPECT_EQ(parsed->daemon.control_socket, defaults.daemon.control_socket);
  EXPECT_EQ(parsed->daemon.control_group, defaults.daemon.control_group);
  EXPECT_EQ(parsed->daemon.workers, defaults.daemon.workers);
  EXPECT_EQ(parsed->daemon.mapper_ring, defaults.daemon.mapper_ring);
  EXPECT_EQ(parsed->daemon.recorder_ring, defaults.daemon.recorder_ring);
  EXPECT_FALSE(parsed->mapper.limits.never_full);
  EXPECT_TRUE(parsed->graph_parts.landmark_rows);
  EXPECT_TRUE(parsed->graph_parts.contradiction_test);
  EXPECT_TRUE(parsed->graph_parts.pairwise_consistency);
  EXPECT_TRUE(parsed->graph_parts.robust_loss);
  EXPECT_EQ(parsed->daemon.slow_mapper_ms, defaults.daemon.slow_mapper_ms);
  EXPECT_EQ(parsed->lcm.url, defaults.lcm.url);
  EXPECT_EQ(parsed->lcm.prefix, defaults.lcm.prefix);
  EXPECT_EQ(parsed->lcm.scan_every, defaults.lcm.scan_every);
  EXPECT_EQ(parsed->recorder.raw, defaults.recorder.raw);
  EXPECT_EQ(parsed->recorder.raw_file_bytes, defaults.recorder.raw_file_bytes);
  EXPECT_EQ(parsed->recorder.disk_low_bytes, defaults.recorder.disk_low_bytes);
  EXPECT_EQ(parsed->recorder.disk_last_bytes, defaults.recorder.disk_last_bytes);
  const ScannerMount& mount = parsed->scanner.vertical_mount;
  EXPECT_EQ(mount.x_m, 0.0);
  EXPECT_EQ(mount.y_m, 0.0);
  EXPECT_EQ(mount.z_m, 0.0);
  EXPECT_EQ(mount.roll_rad, 0.0);
  EXPECT_NEAR(mount.pitch_rad, defaults.scanner.vertical_mount.pitch_rad, 1e-5) << "six digits of pi/2";
  EXPECT_EQ(mount.yaw_rad, 0.0);
  EXPECT_EQ(parsed->lcm.odometry, defaults.lcm.odometry);
  EXPECT_EQ(parsed->lcm.triggers, defaults.lcm.triggers);
  EXPECT_EQ(parsed->lcm.commands, defaults.lcm.commands);
  EXPECT_EQ(parsed->button.device, defaults.button.device);
  EXPECT_EQ(parsed->button.key, defaults.button.key);
  EXPECT_EQ(parsed->button.cloud, defaults.button.cloud);
  EXPECT_EQ(parsed->hook.command, defaults.hook.command);
  EXPECT_EQ(parsed->hook.longest_s, defaults.hook.longest_s);
  EXPECT_EQ(described_keys().size(), 62U) << "compare the new key's field above";
}

TEST(ConfigurationTest, EveryKeySetsItsField) {
  const std::string text = R"(
[scanner]
horizontal = "H0903971"
vertical = "00900001"
horizontal_port = "1-1.2"
vertical_port = "1-2"
intensity = true
stamp_to_first_beam = 3125.0
vertical_x = 0.1
vertical_y = 0.2
vertical_z = 0.3
vertical_roll = 0.4
vertical_pitch = 0.5
vertical_yaw = 0.6
[daemon]
state = "/srv/cart"
control_socket = "/srv/socket"
control_group = "cart-operators"
workers = 3
[lcm]
url = "udpm://239.255.76.68:7668?ttl=1"
prefix = "CART_7"
scan_every = 5
odometry = true
triggers = true
commands = true
[recorder]
raw = false
raw_file = 31000000
disk_low = 32000000
disk_last = 33000000
[button]
device = "/dev/input/by-id/pedal"
key = 30
cloud = true
[hook]
command = "/usr/local/bin/lamp"
longest = 31
[filter]
mode = "fastslam"
particles = 11
max_adaptive_particles = 12
seed = 9000000000000000
covariance_kappa = 13
[keyframe]
distance = 0.14
turn = 0.15
wait = 16.5
[submap]
path = 17.0
keyframes = 18
extent = 19.0
turn = 20.0
[map]
cell = 0.21
carve_range = 22.0
error_code_is_free = true
[budget]
map_blocks = 230
surface_faces = 2400
distance_planes = 2500
mapper_ring = 34
recorder_ring = 35
submap_cache = 26000000
graph = 2700000
map_raster = 28000000
[experiment]
unwarp = false
line_matching = false
single_map = true
landmark_rows = false
contradiction_test = false
pairwise_consistency = false
robust_loss = false
slow_mapper = 125
)";
  const Expected<Configuration> parsed = parse_configuration(text, "cart.toml");
  ASSERT_TRUE(parsed.has_value()) << parsed.error().message();
  EXPECT_EQ(parsed->scanner.roles[0].serial, "H0903971");
  EXPECT_EQ(parsed->scanner.roles[1].serial, "00900001");
  EXPECT_EQ(parsed->scanner.roles[0].port, "1-1.2");
  EXPECT_EQ(parsed->scanner.roles[1].port, "1-2");
  EXPECT_TRUE(parsed->scanner.intensity);
  EXPECT_EQ(parsed->scanner.stamp_to_first_beam_us, 3125.0);
  EXPECT_EQ(parsed->daemon.state, "/srv/cart");
  EXPECT_EQ(parsed->daemon.control_socket, "/srv/socket");
  EXPECT_EQ(parsed->daemon.control_group, "cart-operators");
  EXPECT_EQ(parsed->daemon.workers, 3);
  EXPECT_EQ(parsed->daemon.mapper_ring, 34);
  EXPECT_EQ(parsed->daemon.recorder_ring, 35);
  EXPECT_EQ(parsed->lcm.url, "udpm://239.255.76.68:7668?ttl=1");
  EXPECT_EQ(parsed->lcm.prefix, "CART_7");
  EXPECT_EQ(parsed->lcm.scan_every, 5);
  EXPECT_FALSE(parsed->recorder.raw);
  EXPECT_EQ(parsed->recorder.raw_file_bytes, 31'000'000U);
  EXPECT_EQ(parsed->recorder.disk_low_bytes, 32'000'000U);
  EXPECT_EQ(parsed->recorder.disk_last_bytes, 33'000'000U);
  const ScannerMount& mount = parsed->scanner.vertical_mount;
  EXPECT_EQ(mount.x_m, 0.1);
  EXPECT_EQ(mount.y_m, 0.2);
  EXPECT_EQ(mount.z_m, 0.3);
  EXPECT_EQ(mount.roll_rad, 0.4);
  EXPECT_EQ(mount.pitch_rad, 0.5);
  EXPECT_EQ(mount.yaw_rad, 0.6);
  EXPECT_TRUE(parsed->lcm.odometry);
  EXPECT_TRUE(parsed->lcm.triggers);
  EXPECT_TRUE(parsed->lcm.commands);
  EXPECT_EQ(parsed->button.device, "/dev/input/by-id/pedal");
  EXPECT_EQ(parsed->button.key, 30);
  EXPECT_TRUE(parsed->button.cloud);
  EXPECT_EQ(parsed->hook.command, "/usr/local/bin/lamp");
  EXPECT_EQ(parsed->hook.longest_s, 31);
  EXPECT_EQ(changed_keys(Configuration{}, *parsed).size(), described_keys().size()) << "every key is another";
  EXPECT_TRUE(changed_keys(*parsed, *parsed).empty());
  const MapperOptions& m = parsed->mapper;
  EXPECT_EQ(m.filter, FilterMode::kFastSlam);
  EXPECT_EQ(m.particles, 11);
  EXPECT_EQ(m.max_adaptive_particles, 12);
  EXPECT_EQ(m.seed, 9'000'000'000'000'000U);
  EXPECT_EQ(m.covariance_kappa, 13.0);
  EXPECT_EQ(m.keyframe_m, 0.14);
  EXPECT_EQ(m.keyframe_rad, 0.15);
  EXPECT_EQ(m.keyframe_s, 16.5);
  EXPECT_EQ(m.limits.path_m, 17.0);
  EXPECT_EQ(m.limits.keyframes, 18);
  EXPECT_EQ(m.limits.extent_m, 19.0);
  EXPECT_EQ(m.limits.heading_rad, 20.0);
  EXPECT_EQ(m.map.cell_m, 0.21);
  EXPECT_EQ(m.map.free_space.max_range_m, 22.0);
  EXPECT_TRUE(m.points.error_code_is_free);
  EXPECT_EQ(m.map.max_blocks, 230);
  EXPECT_EQ(m.map.max_faces, 2400);
  EXPECT_EQ(m.distance_planes, 2500);
  EXPECT_EQ(parsed->submap_cache_bytes, 26'000'000U);
  EXPECT_EQ(parsed->graph_bytes, 2'700'000U);
  EXPECT_EQ(parsed->map_raster_bytes, 28'000'000U);
  EXPECT_FALSE(m.unwarp);
  EXPECT_FALSE(m.matcher.use_lines);
  EXPECT_TRUE(m.limits.never_full);
  EXPECT_FALSE(parsed->graph_parts.landmark_rows);
  EXPECT_FALSE(parsed->graph_parts.contradiction_test);
  EXPECT_FALSE(parsed->graph_parts.pairwise_consistency);
  EXPECT_FALSE(parsed->graph_parts.robust_loss);
  EXPECT_EQ(parsed->daemon.slow_mapper_ms, 125.0);
}

TEST(ConfigurationTest, NumbersAreTakenAtBothEndsOfTheirRangeAndRefusedBeyond) {
  int numbers = 0;
  for (const DescribedKey& key : described_keys()) {
    SCOPED_TRACE(key.section + "." + key.name + ": " + key.rule);
    Range range;
    if (!range_of(key, range)) continue;
    ++numbers;
    EXPECT_LT(range.low, range.high);
    EXPECT_EQ(error_of(file_with(key, number(range.low, range.whole))), "");
    EXPECT_EQ(error_of(file_with(key, number(range.high, range.whole))), "");
    const double step = range.whole ? 1.0 : 1e-6 * range.high;
    for (const double beyond : {range.low - step, range.high + step, -1e30, 1e30}) {
      if (range.whole && std::abs(beyond) > 9e18) continue;
      const std::string error = error_of(file_with(key, number(beyond, range.whole)));
      EXPECT_THAT(error, HasSubstr("cart.toml:2: \"" + key.name + "\" must be " + key.rule)) << beyond;
    }
    for (const char* const wrong : {"\"1\"", "true", "nan", "inf", "[1]", "{a = 1}", "1979-05-27"}) {
      EXPECT_THAT(error_of(file_with(key, wrong)), HasSubstr("cart.toml:2: \"" + key.name + "\" must be ")) << wrong;
    }
    if (range.whole) {
      EXPECT_THAT(error_of(file_with(key, number(range.low, true) + ".5")), HasSubstr("whole number"));
    }
    if (!range.whole && std::ceil(range.low) <= range.high) {
      EXPECT_EQ(error_of(file_with(key, fmt::format("{:.0f}", std::ceil(range.low)))), "") << "2 is a number too";
    }
  }
  EXPECT_EQ(numbers, 36);
}

TEST(ConfigurationTest, SwitchesAndTextsTakeTheirValuesOnly) {
  std::vector<std::string> texts;
  for (const DescribedKey& key : described_keys()) {
    SCOPED_TRACE(key.section + "." + key.name + ": " + key.rule);
    Range range;
    if (range_of(key, range)) continue;
    if (key.rule == "true or false") {
      EXPECT_EQ(error_of(file_with(key, "true")), "");
      EXPECT_EQ(error_of(file_with(key, "false")), "");
      for (const char* const wrong : {"1", "\"true\"", "0.0"}) {
        EXPECT_THAT(error_of(file_with(key, wrong)), HasSubstr("must be true or false")) << wrong;
      }
      continue;
    }
    if (key.rule.starts_with("at most 32 ")) {
      for (const char* const good : {"", "H0903971", "1-1.2", "abcdefghijklmnopqrstuvwxyz012345"}) {
        EXPECT_EQ(error_of(file_with(key, fmt::format("\"{}\"", good))), "");
      }
      for (const char* const wrong : {"1", "\"H0 1\"", "\"\\u0000\"", "\"abcdefghijklmnopqrstuvwxyz0123456\""}) {
        EXPECT_THAT(error_of(file_with(key, wrong)), HasSubstr(key.rule)) << wrong;
      }
      continue;
    }
    if (key.rule.starts_with("empty, or ")) {
      for (const char* const good : {"\"\"", "\"/dev/input/by-id/pedal\""}) {
        EXPECT_EQ(error_of(file_with(key, good)), "");
      }
      for (const char* const wrong : {"1", "\"pedal\"", "\"/a b\""}) {
        EXPECT_THAT(error_of(file_with(key, wrong)), HasSubstr(key.rule)) << wrong;
      }
      continue;
    }
    if (!key.rule.starts_with("one of ")) {
      texts.push_back(key.name);
      EXPECT_EQ(error_of(file_with(key, key.value)), "");
      for (const std::string& wrong :
           {std::string("1"), std::string("\"\""), std::string("\"a b\""), "\"" + std::string(101, '/') + "\""}) {
        EXPECT_THAT(error_of(file_with(key, wrong)), HasSubstr(key.rule)) << wrong;
      }
      continue;
    }
    std::istringstream choices(key.rule.substr(7));
    for (std::string choice; choices >> choice;) {
      if (choice.back() == ',') choice.pop_back();
      EXPECT_EQ(error_of(file_with(key, '"' + choice + '"')), "");
      EXPECT_THAT(error_of(file_with(key, '"' + choice + "x\"")), HasSubstr(key.rule));
    }
    EXPECT_THAT(error_of(file_with(key, "1")), HasSubstr(key.rule));
  }
  EXPECT_THAT(texts, testing::ElementsAre("state", "control_socket", "url", "prefix"));
}

TEST(ConfigurationTest, UnknownNamesAreToldWithTheKnownOnes) {
  EXPECT_EQ(error_of("[keyframe]\n\ndistanse = 1\n"),
            "cart.toml:3: unknown key \"distanse\" in [keyframe]; known are distance, turn, wait");
  EXPECT_THAT(error_of("\n[keyfram]\ndistance = 1\n"), HasSubstr("unknown section [keyfram]"));
  EXPECT_THAT(
      error_of("\n[keyfram]\ndistance = 1\n"),
      HasSubstr(
          "known are scanner, daemon, lcm, recorder, button, hook, filter, keyframe, submap, map, budget, experiment"));
  EXPECT_THAT(error_of("[nothing]\n"), HasSubstr("cart.toml:1: unknown section [nothing]")) << "an empty one too";
  EXPECT_THAT(error_of("particles = 3\n"), HasSubstr("cart.toml:1: key \"particles\" stands outside any section"));
}

TEST(ConfigurationTest, WhatIsNoTomlIsToldWithItsLine) {
  EXPECT_THAT(error_of("[filter]\nparticles = \n"), HasSubstr("cart.toml:2: "));
  EXPECT_THAT(error_of("[filter\n"), HasSubstr("cart.toml:1: "));
  EXPECT_THAT(error_of("[filter]\nseed = 1\nseed = 2\n"), HasSubstr("cart.toml:3: "));
  EXPECT_NE(error_of(std::string("\0\xff\xfe", 3)), "");
  EXPECT_NE(error_of(std::string(100'000, '[')), "");
}

TEST(ConfigurationTest, FilesAreReadOrTold) {
  const TemporaryFolder folder;
  const std::string path = (folder.path() / "cart.toml").string();
  Expected<Configuration> loaded = load_configuration(path);
  ASSERT_FALSE(loaded.has_value());
  EXPECT_EQ(loaded.error().code(), StatusCode::kNotFound);
  EXPECT_THAT(loaded.error().message(), HasSubstr(path));

  std::ofstream(path) << "[filter]\nparticles = 7\n";
  loaded = load_configuration(path);
  ASSERT_TRUE(loaded.has_value()) << loaded.error().message();
  EXPECT_EQ(loaded->mapper.particles, 7);

  std::ofstream(path, std::ios::trunc).flush();
  loaded = load_configuration(path);
  EXPECT_TRUE(loaded.has_value()) << "an empty file sets nothing: " << loaded.error().message();

  std::ofstream(path, std::ios::trunc) << "[filter]\n\nparticles = 0\n";
  loaded = load_configuration(path);
  ASSERT_FALSE(loaded.has_value());
  EXPECT_THAT(loaded.error().message(), HasSubstr(path + ":3: "));

  loaded = load_configuration(folder.path().string());
  ASSERT_FALSE(loaded.has_value());
  EXPECT_EQ(loaded.error().code(), StatusCode::kInvalidArgument);
  EXPECT_THAT(loaded.error().message(), HasSubstr(folder.path().string()));
}

TEST(ConfigurationTest, ThePageShowsTheKeysAsTheyAre) {
  std::ifstream file(CONFIGURATION_PAGE, std::ios::binary);
  const std::string page{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  const std::string fence = "```toml\n";
  const std::size_t start = page.find(fence);
  ASSERT_NE(start, std::string::npos) << CONFIGURATION_PAGE;
  const std::size_t begin = start + fence.size();
  const std::size_t end = page.find("```", begin);
  ASSERT_NE(end, std::string::npos);
  EXPECT_EQ(page.substr(begin, end - begin), describe_configuration())
      << "put what describe_configuration() says into the page";
}

TEST(ConfigurationTest, TheShippedFileIsLoaded) {
  const Expected<Configuration> shipped = load_configuration(SHIPPED_CONFIGURATION);
  ASSERT_TRUE(shipped.has_value()) << shipped.error().message();
  EXPECT_EQ(shipped->daemon.control_group, "submapd-operators");
}

// What the ranges allow, the mapper can work with.
TEST(ConfigurationTest, AMapperWorksAtBothEndsOfEveryKey) {
  for (const DescribedKey& key : described_keys()) {
    Range range;
    if (!range_of(key, range)) continue;
    for (const double end : {range.low, range.high}) {
      if (key.section == "budget" && end == range.high) continue;  // only needs memory
      SCOPED_TRACE(fmt::format("{}.{} = {}", key.section, key.name, end));
      const Expected<Configuration> parsed = parse_configuration(file_with(key, number(end, range.whole)), "cart.toml");
      ASSERT_TRUE(parsed.has_value());
      SerialPool pool;
      Mapper mapper(parsed->mapper, Uuid::from_seed(1, 1), Uuid::from_seed(1, 2), pool);
      for (std::uint64_t k = 0; k < 16; ++k) {
        Scan scan;
        scan.index = k;
        scan.stamp_us = 1'000'000 + static_cast<std::int64_t>(k) * 100'000;
        // A square room of 6 m a side, seen from a cart that drives 2 m along x.
        const double x = 0.125 * static_cast<double>(k);
        for (int i = 0; i <= 180; ++i) {
          scan.geometry.angle_step_rad = 0.75 * 2.0 * std::numbers::pi / 180.0;
          const double a = scan.geometry.first_angle_rad + i * scan.geometry.angle_step_rad;
          const double across = 3.0 / std::max(std::abs(std::sin(a)), 1e-6);
          const double along = (std::cos(a) > 0.0 ? 3.0 - x : 3.0 + x) / std::max(std::abs(std::cos(a)), 1e-6);
          scan.ranges_mm.push_back(static_cast<std::uint16_t>(1000.0 * std::min(across, along)));
        }
        const ScanReport report = mapper.process(scan);
        ASSERT_TRUE(std::isfinite(report.odom_from_base.x) && std::isfinite(report.odom_from_base.yaw));
        static_cast<void>(mapper.take_finished());
      }
    }
  }
}

}  // namespace
}  // namespace submapd
