// The configuration file (TOML): every key with unit, range and default; an unknown key or a bad value is an error that
// names file and line. configuration.md is the page for people.
//
// One parameter file serves all sites and scanners: what is here is about the cart and its budget, not about buildings.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "driver/sensor_roles.hpp"
#include "slam/base/status.hpp"
#include "slam/filter/mapper.hpp"
#include "slam/graph/optimizer.hpp"
#include "slam/output/point_cloud.hpp"

namespace submapd {

struct ScannerConfiguration {
  driver::RoleRules roles;              // nobody has a role until it is configured
  bool intensity = false;               // ask for echo strengths too, which some firmware does not stand
  double stamp_to_first_beam_us = 0.0;  // the first beam comes that long after the instant of the stamp
  ScannerMount vertical_mount;          // of the vertical one, for the cloud
};

struct DaemonConfiguration {
  std::string state = "/var/lib/submapd";  // folder of the runs and of the cart's identity
  std::string control_socket = "/run/submapd/control";
  std::string control_group;    // who may use the socket besides the daemon's user; empty: the daemon's own group
  int workers = 1;              // threads that help the mapper while it has several particles
  int mapper_ring = 160;        // scans that may wait for the mapper
  int recorder_ring = 400;      // scans of each scanner that may wait for the recorder
  double slow_mapper_ms = 0.0;  // [experiment]: each scan takes so much longer
};

struct LcmConfiguration {
  std::string url = "udpm://239.255.76.67:7667?ttl=0";
  std::string prefix = "CART";  // of all channels
  int scan_every = 4;           // each so many-th scan goes out; 0: none
  bool odometry = false;        // CART_ODOMETRY reaches the mapper
  bool triggers = false;        // CART_TRIGGER sets marks
  bool commands = false;        // CART_COMMAND is obeyed, whoever sends it
};

// A key that saves the map: of a USB keypad, a foot switch.
struct ButtonConfiguration {
  std::string device;  // /dev/input/by-id/...; empty: none
  int key = 28;        // KEY_ENTER of linux/input-event-codes.h
  bool cloud = false;  // with cloud.ply
};

// A program that tells the operator how it went: a tone, a lamp.
struct HookConfiguration {
  std::string command;  // empty: none
  int longest_s = 10;   // then it is killed
};

struct RecorderConfiguration {
  bool raw = true;                                      // write all scans of both scanners
  std::size_t raw_file_bytes = std::size_t{256} << 20;  // then the next file begins
  std::size_t disk_low_bytes = std::size_t{4} << 30;    // less room than this is told
  std::size_t disk_last_bytes = std::size_t{1} << 30;   // and here raw recording stops; sub-maps and maps go on
};

struct Configuration {
  ScannerConfiguration scanner;
  DaemonConfiguration daemon;
  LcmConfiguration lcm;
  RecorderConfiguration recorder;
  ButtonConfiguration button;
  HookConfiguration hook;
  MapperOptions mapper;
  GraphParts graph_parts;
  std::size_t submap_cache_bytes = std::size_t{16} << 20;
  std::size_t graph_bytes = std::size_t{6} << 20;
  std::size_t map_raster_bytes = std::size_t{32} << 20;
};

// Reads a file. kNotFound, kIo, or kInvalidArgument with "FILE:LINE: what is wrong and what is allowed".
[[nodiscard]] Expected<Configuration> load_configuration(const std::string& path);
// The same from text; `name` stands for the file in messages.
[[nodiscard]] Expected<Configuration> parse_configuration(std::string_view text, std::string_view name);

// "section.key" of everything that differs, in the order of the file.
[[nodiscard]] std::vector<std::string> changed_keys(const Configuration& before, const Configuration& after);

// Every key with its unit, range and default, as a commented TOML file.
[[nodiscard]] std::string describe_configuration();

}  // namespace submapd
