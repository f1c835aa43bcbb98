#include "daemon/configuration.hpp"

#include <fmt/format.h>

#include <toml++/toml.h>
#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>
#include <variant>
#include <vector>

namespace submapd {
namespace {

// A key: where it stands, what it means, what it may be, and the field it sets.
struct Key {
  std::string_view section;
  std::string_view name;
  std::string_view unit;
  std::string_view meaning;
  double low = 0.0;
  double high = 0.0;
  std::variant<double*, int*, std::uint64_t*, bool*, std::function<bool(std::string_view)>> field;
  std::string words;  // what a text key may be
  std::string text_default;
};

constexpr auto kLetterOrDigit = [](char c) {
  return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z');
};

// A text that is taken as it is if it fulfils `good`, which `words` describe.
Key text_key(std::string_view section, std::string_view name, std::string_view meaning, std::string* field,
             std::string words, bool (*good)(std::string_view)) {
  const auto set = [field, good](std::string_view value) {
    if (!good(value)) return false;
    *field = value;
    return true;
  };
  return {section, name, "", meaning, 0, 0, set, std::move(words), *field};
}

// A serial number, a port or a group: what all may hold is all that is checked, the rest is others' affair.
Key short_text_key(std::string_view section, std::string_view name, std::string_view meaning, std::string* field) {
  return text_key(
      section, name, meaning, field, "at most 32 letters, digits, points and dashes", [](std::string_view value) {
        return value.size() <= 32 && std::all_of(value.begin(), value.end(),
                                                 [](char c) { return kLetterOrDigit(c) || c == '-' || c == '.'; });
      });
}

Key path_key(std::string_view section, std::string_view name, std::string_view meaning, std::string* field) {
  // sockaddr_un holds 107 characters.
  return text_key(section, name, meaning, field, "an absolute path of at most 100 printable characters",
                  [](std::string_view value) {
                    return value.starts_with('/') && value.size() <= 100 &&
                           std::all_of(value.begin(), value.end(), [](char c) { return c > ' ' && c < '\x7f'; });
                  });
}

// A path, or nothing.
Key optional_path_key(std::string_view section, std::string_view name, std::string_view meaning, std::string* field) {
  return text_key(section, name, meaning, field, "empty, or an absolute path of at most 100 printable characters",
                  [](std::string_view value) {
                    return value.empty() ||
                           (value.starts_with('/') && value.size() <= 100 &&
                            std::all_of(value.begin(), value.end(), [](char c) { return c > ' ' && c < '\x7f'; }));
                  });
}

Key prefix_key(std::string_view section, std::string_view name, std::string_view meaning, std::string* field) {
  return text_key(section, name, meaning, field, "1 to 40 letters, digits and underscores", [](std::string_view value) {
    return !value.empty() && value.size() <= 40 &&
           std::all_of(value.begin(), value.end(), [](char c) { return kLetterOrDigit(c) || c == '_'; });
  });
}

Key url_key(std::string_view section, std::string_view name, std::string_view meaning, std::string* field) {
  return text_key(section, name, meaning, field, "udpm://GROUP:PORT?ttl=N, at most 100 printable characters",
                  [](std::string_view value) {
                    return value.starts_with("udpm://") && value.size() <= 100 &&
                           std::all_of(value.begin(), value.end(), [](char c) { return c > ' ' && c < '\x7f'; });
                  });
}

std::string mode_name(FilterMode mode) {
  return mode == FilterMode::kRbpf ? "rbpf" : mode == FilterMode::kFastSlam ? "fastslam" : "adaptive";
}

std::vector<Key> keys_of(Configuration& c) {
  MapperOptions& m = c.mapper;
  std::vector<Key> keys;
  const auto add = [&keys](std::string_view section, std::string_view name, std::string_view unit, double low,
                           double high, auto* field, std::string_view meaning) {
    keys.push_back({section, name, unit, meaning, low, high, field, "", ""});
  };
  driver::RoleRule& horizontal = c.scanner.roles[0];
  driver::RoleRule& vertical = c.scanner.roles[1];
  keys.push_back(short_text_key("scanner", "horizontal", "serial number of the scanner that maps", &horizontal.serial));
  keys.push_back(
      short_text_key("scanner", "vertical", "serial number of the upright one, if there is one", &vertical.serial));
  keys.push_back(short_text_key("scanner", "horizontal_port", "or the port it is plugged into", &horizontal.port));
  keys.push_back(short_text_key("scanner", "vertical_port", "or the port of the upright one", &vertical.port));
  add("scanner", "intensity", "", 0, 0, &c.scanner.intensity, "ask for echo strengths, too much for some firmware");
  add("scanner", "stamp_to_first_beam", "us", -25'000, 25'000, &c.scanner.stamp_to_first_beam_us,
      "the first beam comes this long after the stamp");
  ScannerMount& mount = c.scanner.vertical_mount;
  add("scanner", "vertical_x", "m", -10, 10, &mount.x_m, "the upright one is this far in front of the one that maps");
  add("scanner", "vertical_y", "m", -10, 10, &mount.y_m, "this far to its left");
  add("scanner", "vertical_z", "m", -10, 10, &mount.z_m, "and this high above the floor, from where the cloud counts");
  add("scanner", "vertical_roll", "rad", -3.2, 3.2, &mount.roll_rad, "turned about the cart's forward axis, first");
  add("scanner", "vertical_pitch", "rad", -3.2, 3.2, &mount.pitch_rad, "then about its left axis; upright is -pi/2");
  add("scanner", "vertical_yaw", "rad", -3.2, 3.2, &mount.yaw_rad, "then about its upward axis");
  keys.push_back(path_key("daemon", "state", "folder of the runs and of the cart's identity", &c.daemon.state));
  keys.push_back(path_key("daemon", "control_socket", "where submapctl asks", &c.daemon.control_socket));
  keys.push_back(short_text_key("daemon", "control_group", "who may ask; empty for the daemon's own group",
                                &c.daemon.control_group));
  add("daemon", "workers", "", 0, 3, &c.daemon.workers, "threads that help the mapper with many particles");
  keys.push_back(url_key("lcm", "url", "multicast group", &c.lcm.url));
  keys.push_back(prefix_key("lcm", "prefix", "of all channels", &c.lcm.prefix));
  add("lcm", "scan_every", "", 0, 4000, &c.lcm.scan_every, "each so many-th scan is sent; 0 for none");
  add("lcm", "odometry", "", 0, 0, &c.lcm.odometry, "messages on CART_ODOMETRY help the mapper");
  add("lcm", "triggers", "", 0, 0, &c.lcm.triggers, "messages on CART_TRIGGER set marks");
  add("lcm", "commands", "", 0, 0, &c.lcm.commands, "messages on CART_COMMAND are obeyed, whoever sends them");
  add("recorder", "raw", "", 0, 0, &c.recorder.raw, "write all scans of both scanners");
  add("recorder", "raw_file", "bytes", 1 << 16, 1e12, &c.recorder.raw_file_bytes, "then the next raw file begins");
  add("recorder", "disk_low", "bytes", 0, 1e13, &c.recorder.disk_low_bytes, "less room on the disk is told");
  add("recorder", "disk_last", "bytes", 0, 1e13, &c.recorder.disk_last_bytes,
      "with less, raw recording stops; sub-maps and maps go on");
  keys.push_back(optional_path_key("button", "device", "input device whose key saves the map", &c.button.device));
  add("button", "key", "", 1, 767, &c.button.key, "the key's code as in linux/input-event-codes.h; 28 is Enter");
  add("button", "cloud", "", 0, 0, &c.button.cloud, "the saved map has a cloud");
  keys.push_back(optional_path_key("hook", "command", "program that is told how saving went", &c.hook.command));
  add("hook", "longest", "s", 1, 300, &c.hook.longest_s, "then it is killed");
  keys.push_back({"filter", "mode", "", "particle filter: adaptive, rbpf (fixed number) or fastslam (textbook)", 0, 0,
                  [&m](std::string_view value) {
                    if (value == "adaptive")
                      m.filter = FilterMode::kAdaptive;
                    else if (value == "rbpf")
                      m.filter = FilterMode::kRbpf;
                    else if (value == "fastslam")
                      m.filter = FilterMode::kFastSlam;
                    else
                      return false;
                    return true;
                  },
                  "one of adaptive, rbpf, fastslam", mode_name(m.filter)});
  add("filter", "particles", "", 1, 500, &m.particles, "number of particles of rbpf and fastslam");
  add("filter", "max_adaptive_particles", "", 1, 500, &m.max_adaptive_particles, "most particles adaptive may spread");
  add("filter", "seed", "", 0, 9e15, &m.seed, "of all random numbers");
  add("filter", "covariance_kappa", "", 1, 1000, &m.covariance_kappa,
      "neighbouring beams are correlated: information / kappa");
  add("keyframe", "distance", "m", 0.01, 5, &m.keyframe_m, "a key-frame after this distance");
  add("keyframe", "turn", "rad", 0.005, 1, &m.keyframe_rad, "or this turn");
  add("keyframe", "wait", "s", 0.1, 60, &m.keyframe_s, "or this time with a little motion");
  add("submap", "path", "m", 2, 200, &m.limits.path_m, "a sub-map is full after this path");
  add("submap", "keyframes", "", 10, 20'000, &m.limits.keyframes, "or this many key-frames");
  add("submap", "extent", "m", 5, 150, &m.limits.extent_m, "or this extent of the path");
  add("submap", "turn", "rad", 1, 100, &m.limits.heading_rad, "or this much turning");
  add("map", "cell", "m", 0.01, 0.5, &m.map.cell_m, "side of a grid cell");
  add("map", "carve_range", "m", 1, 100, &m.map.free_space.max_range_m, "free space is marked this far");
  add("map", "error_code_is_free", "", 0, 0, &m.points.error_code_is_free, "range code 1 means free up to the limit");
  add("budget", "map_blocks", "blocks", 50, 4000, &m.map.max_blocks, "blocks of 64 x 64 cells of one active sub-map");
  add("budget", "surface_faces", "", 1000, 65535, &m.map.max_faces, "surface statistics of one active sub-map");
  add("budget", "distance_planes", "4 kB", 500, 65535, &m.distance_planes,
      "distance field blocks, all particles together");
  add("budget", "mapper_ring", "scans", 8, 4000, &c.daemon.mapper_ring, "scans that may wait for the mapper");
  add("budget", "recorder_ring", "scans", 8, 8000, &c.daemon.recorder_ring,
      "scans of each scanner that may wait for the recorder");
  add("budget", "submap_cache", "bytes", 1 << 20, 1e10, &c.submap_cache_bytes, "finished sub-maps kept in memory");
  add("budget", "graph", "bytes", 1 << 16, 1e10, &c.graph_bytes, "pose graph, landmarks and loops");
  add("budget", "map_raster", "bytes", 1 << 20, 1e10, &c.map_raster_bytes, "the whole map while it is saved");
  add("experiment", "unwarp", "", 0, 0, &m.unwarp, "false: beams are not moved to the scan's stamp");
  add("experiment", "line_matching", "", 0, 0, &m.matcher.use_lines, "false: stage 2 of the matcher is off");
  add("experiment", "single_map", "", 0, 0, &m.limits.never_full, "true: the run is one map, no sub-map is ever full");
  add("experiment", "landmark_rows", "", 0, 0, &c.graph_parts.landmark_rows,
      "false: a confirmed loop is one relative-pose edge");
  add("experiment", "contradiction_test", "", 0, 0, &c.graph_parts.contradiction_test,
      "false: a match of sub-maps may contradict free space");
  add("experiment", "pairwise_consistency", "", 0, 0, &c.graph_parts.pairwise_consistency,
      "false: a loop needs no other one that agrees");
  add("experiment", "robust_loss", "", 0, 0, &c.graph_parts.robust_loss,
      "false: the final graph is solved by plain squares");
  add("experiment", "slow_mapper", "ms", 0, 1000, &c.daemon.slow_mapper_ms, "the mapper takes this much longer a scan");
  return keys;
}

std::string sections_of(const std::vector<Key>& keys) {
  std::string sections;
  std::string_view last;
  for (const Key& key : keys) {
    if (key.section == last) continue;
    last = key.section;
    sections += fmt::format("{}{}", sections.empty() ? "" : ", ", last);
  }
  return sections;
}

std::string allowed(const Key& key) {
  if (std::holds_alternative<bool*>(key.field)) return "true or false";
  if (!key.words.empty()) return key.words;
  const std::string unit = fmt::format("{}{}", key.unit.empty() ? "" : " ", key.unit);
  if (!std::holds_alternative<double*>(key.field))
    return fmt::format("a whole number from {:.0f} to {:.0f}{}", key.low, key.high, unit);
  return fmt::format("a number from {:g} to {:g}{}", key.low, key.high, unit);
}

// Sets the field from a value; false if the value is not allowed.
bool assign(const Key& key, const toml::node& node) {
  if (const auto* text = std::get_if<std::function<bool(std::string_view)>>(&key.field)) {
    const auto value = node.value_exact<std::string>();
    return value && (*text)(*value);
  }
  if (bool* const* flag = std::get_if<bool*>(&key.field)) {
    const auto value = node.value_exact<bool>();
    if (value) **flag = *value;
    return value.has_value();
  }
  const bool whole = !std::holds_alternative<double*>(key.field);
  const auto value = node.is_number() && (!whole || node.is_integer()) ? node.value<double>() : std::nullopt;
  if (!value || !(*value >= key.low && *value <= key.high)) return false;
  if (double* const* real = std::get_if<double*>(&key.field)) **real = *value;
  if (int* const* number = std::get_if<int*>(&key.field)) **number = static_cast<int>(*value);
  if (std::uint64_t* const* number = std::get_if<std::uint64_t*>(&key.field)) {
    **number = static_cast<std::uint64_t>(*value);
  }
  return true;
}

// The field's value as it would stand in a file.
std::string value_text(const Key& key) {
  if (bool* const* flag = std::get_if<bool*>(&key.field)) return **flag ? "true" : "false";
  if (double* const* real = std::get_if<double*>(&key.field)) return fmt::format("{:.6g}", **real);
  if (int* const* number = std::get_if<int*>(&key.field)) return fmt::format("{}", **number);
  if (std::uint64_t* const* number = std::get_if<std::uint64_t*>(&key.field)) return fmt::format("{}", **number);
  return fmt::format("\"{}\"", key.text_default);
}

}  // namespace

std::vector<std::string> changed_keys(const Configuration& before, const Configuration& after) {
  Configuration copies[] = {before, after};
  const std::vector<Key> old_keys = keys_of(copies[0]);
  const std::vector<Key> new_keys = keys_of(copies[1]);
  std::vector<std::string> changed;
  for (std::size_t i = 0; i < old_keys.size(); ++i) {
    if (value_text(old_keys[i]) == value_text(new_keys[i])) continue;
    changed.push_back(fmt::format("{}.{}", old_keys[i].section, old_keys[i].name));
  }
  return changed;
}

Expected<Configuration> parse_configuration(std::string_view text, std::string_view name) {
  Configuration configuration;
  const std::vector<Key> keys = keys_of(configuration);
  const auto wrong = [name](const toml::source_region& where, const std::string& what) {
    return failure(StatusCode::kInvalidArgument, fmt::format("{}:{}: {}", name, where.begin.line, what));
  };
  toml::table table;
  try {
    table = toml::parse(text, name);
  } catch (const toml::parse_error& error) {
    return wrong(error.source(), std::string(error.description()));
  }
  for (const auto& [section, node] : table) {
    const toml::table* entries = node.as_table();
    if (entries == nullptr)
      return wrong(node.source(), fmt::format("key \"{}\" stands outside any section", section.str()));
    if (std::none_of(keys.begin(), keys.end(), [&s = section](const Key& key) { return key.section == s.str(); })) {
      return wrong(node.source(), fmt::format("unknown section [{}]; known are {}", section.str(), sections_of(keys)));
    }
    for (const auto& [entry, value] : *entries) {
      const Key* found = nullptr;
      std::string known;
      for (const Key& key : keys) {
        if (key.section != section.str()) continue;
        known += fmt::format("{}{}", known.empty() ? "" : ", ", key.name);
        if (key.name == entry.str()) found = &key;
      }
      if (found == nullptr) {
        return wrong(value.source(),
                     fmt::format("unknown key \"{}\" in [{}]; known are {}", entry.str(), section.str(), known));
      }
      if (!assign(*found, value)) {
        return wrong(value.source(), fmt::format("\"{}\" must be {}", entry.str(), allowed(*found)));
      }
    }
  }
  return configuration;
}

Expected<Configuration> load_configuration(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    const StatusCode code = errno == ENOENT ? StatusCode::kNotFound : StatusCode::kIo;
    return failure(code, fmt::format("cannot read configuration {}: {}", path, std::strerror(errno)));
  }
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) {
    return failure(StatusCode::kInvalidArgument, fmt::format("cannot read configuration {}: it is a folder", path));
  }
  std::ostringstream text;
  if (file.peek() != std::ifstream::traits_type::eof())
    text << file.rdbuf();  // which fails where nothing is to be read
  if (file.bad() || text.fail()) {
    return failure(StatusCode::kIo, fmt::format("cannot read configuration {}", path));
  }
  return parse_configuration(text.str(), path);
}

std::string describe_configuration() {
  Configuration defaults;
  std::string out;
  std::string_view section;
  for (const Key& key : keys_of(defaults)) {
    if (key.section != section) {
      out += fmt::format("{}[{}]\n", section.empty() ? "" : "\n", key.section);
      section = key.section;
    }
    out += fmt::format("# {}: {}\n{} = {}\n", key.meaning, allowed(key), key.name, value_text(key));
  }
  return out;
}

}  // namespace submapd
