#include "tools/sensors/role_assignment.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <span>
#include <sstream>
#include <utility>

#include "daemon/configuration.hpp"
#include "driver/sensor_roles.hpp"
#include "slam/base/atomic_file.hpp"

namespace submapd::tools {
namespace {

constexpr std::string_view kSection = "[scanner]";

bool is_serial(std::string_view text) {
  return !text.empty() && text.size() <= 16 && std::all_of(text.begin(), text.end(), [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z');
  });
}

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t\r");
  return first == text.npos ? std::string_view() : text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

// The key that a line sets, or nothing.
std::string_view key_of(std::string_view line) {
  const std::size_t equals = line.find('=');
  return equals == line.npos ? std::string_view() : trimmed(line.substr(0, equals));
}

std::vector<std::string> lines_of(std::string_view text) {
  std::vector<std::string> lines;
  std::istringstream in{std::string(text)};
  for (std::string line; std::getline(in, line);) {
    lines.push_back(line);
  }
  return lines;
}

}  // namespace

Expected<RoleAssignment> parse_assignment(const std::vector<std::string>& words) {
  RoleAssignment roles;
  for (const std::string& word : words) {
    const std::string_view serial = std::string_view(word).substr(std::min<std::size_t>(2, word.size()));
    const bool horizontal = word.starts_with("H=");
    if ((!horizontal && !word.starts_with("V=")) || !is_serial(serial)) {
      return failure(
          StatusCode::kInvalidArgument,
          fmt::format("--assign {}: wants H=SERIAL V=SERIAL, a serial being 1 to 16 letters and digits", word));
    }
    if (horizontal ? !roles.horizontal.empty() : roles.vertical.has_value()) {
      return failure(StatusCode::kInvalidArgument, fmt::format("--assign {}: this role is given twice", word));
    }
    if (horizontal) {
      roles.horizontal = serial;
    } else {
      roles.vertical = serial;
    }
  }
  if (roles.horizontal.empty()) {
    return failure(StatusCode::kInvalidArgument,
                   "--assign: H is missing; without a horizontal scanner nothing is mapped");
  }
  if (roles.vertical && driver::same_serial(roles.horizontal, *roles.vertical)) {
    return failure(StatusCode::kInvalidArgument, "--assign: one scanner cannot be both H and V");
  }
  return roles;
}

std::string with_roles(std::string_view configuration, const RoleAssignment& roles) {
  const std::array<std::pair<std::string_view, std::string>, 4> values = {{{"horizontal", roles.horizontal},
                                                                           {"vertical", roles.vertical.value_or("")},
                                                                           {"horizontal_port", ""},
                                                                           {"vertical_port", ""}}};
  std::vector<std::string> lines = lines_of(configuration);
  auto section = std::find_if(lines.begin(), lines.end(),
                              [](const std::string& line) { return trimmed(line).starts_with(kSection); });
  if (section == lines.end()) {
    if (!lines.empty()) {
      lines.emplace_back();
    }
    lines.emplace_back(kSection);
    section = lines.end() - 1;
  }
  const auto begin = section - lines.begin() + 1;
  for (const auto& [key, value] : values) {
    const auto end = std::find_if(lines.begin() + begin, lines.end(),
                                  [](const std::string& line) { return trimmed(line).starts_with('['); });
    const auto found =
        std::find_if(lines.begin() + begin, end, [key = key](const std::string& line) { return key_of(line) == key; });
    const std::string line = fmt::format("{} = \"{}\"", key, value);
    if (found != end) {
      *found = line;
    } else if (!value.empty()) {
      lines.insert(lines.begin() + begin, line);
    }
  }
  std::string text;
  for (const std::string& line : lines) {
    text += line + '\n';
  }
  return text;
}

Status assign_roles(const std::string& path, const RoleAssignment& roles) {
  std::string before;
  if (std::ifstream file(path, std::ios::binary); file) {
    std::ostringstream text;
    if (file.peek() != std::ifstream::traits_type::eof()) {
      text << file.rdbuf();
    }
    before = text.str();
  } else if (errno != ENOENT) {
    return {StatusCode::kIo, fmt::format("cannot read {}: {}", path, std::strerror(errno))};
  }
  // Checked before and after: a broken file is not made worse, and what is written can be read.
  const std::string after = with_roles(before, roles);
  for (const std::string& text : {before, after}) {
    if (const auto parsed = parse_configuration(text, path); !parsed) {
      return parsed.error();
    }
  }
  return atomic_write_file(path, std::as_bytes(std::span(after)));
}

}  // namespace submapd::tools
