// The configuration file (TOML): every key with unit, range and default; an unknown key or a bad value is an error that
// names file and line. configuration.md is the page for people.
//
// One parameter file serves all sites and scanners: what is here is about the cart and its budget, not about buildings.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "driver/sensor_roles.hpp"
#include "slam/base/status.hpp"
#include "slam/filter/mapper.hpp"

namespace submapd {

struct ScannerConfiguration {
  driver::RoleRules roles;               // nobody has a role until it is configured
  bool intensity = false;                // ask for echo strengths too, which some firmware does not stand
  double stamp_to_first_beam_us = 0.0;   // the first beam comes that long after the instant of the stamp
};

struct Configuration {
  ScannerConfiguration scanner;
  MapperOptions mapper;
  std::size_t submap_cache_bytes = std::size_t{16} << 20;
  std::size_t graph_bytes = std::size_t{16} << 20;
  std::size_t map_raster_bytes = std::size_t{32} << 20;
};

// Reads a file. kNotFound, kIo, or kInvalidArgument with "FILE:LINE: what is wrong and what is allowed".
[[nodiscard]] Expected<Configuration> load_configuration(const std::string& path);
// The same from text; `name` stands for the file in messages.
[[nodiscard]] Expected<Configuration> parse_configuration(std::string_view text, std::string_view name);

// Every key with its unit, range and default, as a commented TOML file.
[[nodiscard]] std::string describe_configuration();

}  // namespace submapd
