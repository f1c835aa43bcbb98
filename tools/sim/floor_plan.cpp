#include "tools/sim/floor_plan.hpp"

#include <fmt/format.h>
#include <zlib.h>

#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <optional>

namespace submapd::tools {
namespace {

constexpr std::size_t kMaxFile_bytes = std::size_t{256} << 20;
constexpr std::size_t kMaxLines = 100'000;
constexpr double kMaxCoordinate_m = 10'000.0;
constexpr int kMaxSide_px = 20'000;
constexpr std::size_t kMaxCells = 100'000'000;
constexpr std::uint8_t kDarkest_free = 240;
constexpr std::uint8_t kLightest_wall = 100;

// Lines of `count` numbers separated by commas.
Expected<std::vector<std::vector<double>>> parse_rows(std::string_view text, const std::string& name,
                                                      std::size_t count) {
  std::vector<std::vector<double>> rows;
  std::size_t line_number = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    ++line_number;
    if (line.ends_with('\r')) {
      line.remove_suffix(1);
    }
    if (line.empty() || line.front() == '#') {
      continue;
    }
    const auto bad = [&](std::string_view what) {
      return failure(StatusCode::kCorrupt,
                     fmt::format("{}:{}: {}; each line has {} numbers in metres separated by commas, within 10 km", name,
                                 line_number, what, count));
    };
    if (rows.size() == kMaxLines) {
      return bad("more than 100000 lines");
    }
    std::vector<double> row;
    const char* at = line.data();
    const char* const stop = line.data() + line.size();
    while (row.size() < count) {
      while (at != stop && *at == ' ') {
        ++at;
      }
      double value = 0.0;
      const auto [after, error] = std::from_chars(at, stop, value);
      if (error != std::errc() || !(std::abs(value) <= kMaxCoordinate_m)) {
        return bad("not a number, or out of range");
      }
      row.push_back(value);
      at = after;
      while (at != stop && *at == ' ') {
        ++at;
      }
      if (row.size() < count) {
        if (at == stop || *at != ',') {
          return bad("too few numbers");
        }
        ++at;
      }
    }
    if (at != stop) {
      return bad("text after the last number");
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

// The next number of a PGM header or P2 body; skips blanks and comments.
std::optional<int> next_number(std::string_view bytes, std::size_t& at) {
  while (at < bytes.size()) {
    const char c = bytes[at];
    if (c == '#') {
      at = std::min(bytes.find('\n', at), bytes.size());
    } else if (c == ' ' || c == '\t' || c == '\r' || c == '\n') {
      ++at;
    } else {
      break;
    }
  }
  int value = 0;
  const auto [after, error] = std::from_chars(bytes.data() + at, bytes.data() + bytes.size(), value);
  if (error != std::errc() || value < 0) {
    return std::nullopt;
  }
  at = static_cast<std::size_t>(after - bytes.data());
  return value;
}

}  // namespace

bool GreyMap::wall(int column, int row) const {
  return column >= 0 && row >= 0 && column < width && row < height &&
         grey[static_cast<std::size_t>(row) * static_cast<std::size_t>(width) + static_cast<std::size_t>(column)] <=
             kLightest_wall;
}

bool GreyMap::free(int column, int row) const {
  return column >= 0 && row >= 0 && column < width && row < height &&
         grey[static_cast<std::size_t>(row) * static_cast<std::size_t>(width) + static_cast<std::size_t>(column)] >=
             kDarkest_free;
}

bool GreyMap::free_at(const Eigen::Vector2d& point) const {
  const double column = std::floor(point.x() / resolution_m);
  const double row = height - 1 - std::floor(point.y() / resolution_m);
  return column >= 0.0 && row >= 0.0 && column < width && row < height &&
         free(static_cast<int>(column), static_cast<int>(row));
}

Expected<std::vector<Segment>> parse_wall_csv(std::string_view text, const std::string& name) {
  const auto rows = parse_rows(text, name, 4);
  if (!rows) {
    return failure(rows.error());
  }
  std::vector<Segment> walls;
  for (const std::vector<double>& row : *rows) {
    walls.push_back({{row[0], row[1]}, {row[2], row[3]}});
  }
  if (walls.empty()) {
    return failure(StatusCode::kCorrupt, name + ": no wall in the file; give lines x1,y1,x2,y2 in metres");
  }
  return walls;
}

Expected<std::vector<Eigen::Vector2d>> parse_waypoints(std::string_view text, const std::string& name) {
  const auto rows = parse_rows(text, name, 2);
  if (!rows) {
    return failure(rows.error());
  }
  std::vector<Eigen::Vector2d> points;
  for (const std::vector<double>& row : *rows) {
    points.emplace_back(row[0], row[1]);
  }
  return points;
}

Expected<GreyMap> parse_pgm(std::string_view bytes, const std::string& name, double resolution_m) {
  const auto bad = [&](std::string_view what) {
    return failure(StatusCode::kCorrupt,
                   fmt::format("{}: {}; give a grey map P2 or P5 of at most 255 levels", name, what));
  };
  const bool binary = bytes.starts_with("P5");
  if (!binary && !bytes.starts_with("P2")) {
    return bad("does not start with P2 or P5");
  }
  if (!(resolution_m >= 0.001 && resolution_m <= 10.0)) {
    return failure(StatusCode::kInvalidArgument,
                   fmt::format("{}: a resolution of {} m is out of range; give 0.001 to 10", name, resolution_m));
  }
  std::size_t at = 2;
  const std::optional<int> width = next_number(bytes, at);
  const std::optional<int> height = next_number(bytes, at);
  const std::optional<int> levels = next_number(bytes, at);
  if (!width || !height || !levels || *width < 1 || *height < 1 || *width > kMaxSide_px || *height > kMaxSide_px ||
      *levels < 1 || *levels > 255) {
    return bad("its header has no sound width, height and number of levels");
  }
  GreyMap map;
  map.width = *width;
  map.height = *height;
  map.resolution_m = resolution_m;
  const std::size_t cells = static_cast<std::size_t>(*width) * static_cast<std::size_t>(*height);
  // A cell takes at least a byte: do not reserve more than the file can fill.
  if (cells > kMaxCells || bytes.size() - at < cells) {
    return bad(fmt::format("{} x {} cells do not fit into its {} bytes", *width, *height, bytes.size()));
  }
  map.grey.resize(cells);
  ++at;  // one blank after the header
  for (std::size_t i = 0; i < cells; ++i) {
    int value = 0;
    if (binary) {
      if (at >= bytes.size()) {
        return bad("it ends early");
      }
      value = static_cast<unsigned char>(bytes[at++]);
    } else {
      const std::optional<int> number = next_number(bytes, at);
      if (!number) {
        return bad(fmt::format("cell {} is not a number", i));
      }
      value = *number;
    }
    if (value > *levels) {
      return bad(fmt::format("cell {} has level {} of {}", i, value, *levels));
    }
    map.grey[i] = static_cast<std::uint8_t>(value * 255 / *levels);
  }
  return map;
}

std::vector<Segment> outline(const GreyMap& map, bool (GreyMap::*in_set)(int, int) const) {
  std::vector<Segment> segments;
  const double side = map.resolution_m;
  const auto border = [&](bool across, int line, int i) {
    return across ? (map.*in_set)(i, line - 1) != (map.*in_set)(i, line)
                  : (map.*in_set)(line - 1, i) != (map.*in_set)(line, i);
  };
  const auto point = [&](bool across, int line, int i) -> Eigen::Vector2d {
    return across ? Eigen::Vector2d(i * side, (map.height - line) * side)
                  : Eigen::Vector2d(line * side, (map.height - i) * side);
  };
  for (const bool across : {true, false}) {
    const int lines = across ? map.height : map.width;
    const int cells = across ? map.width : map.height;
    for (int line = 0; line <= lines; ++line) {
      int start = 0;
      for (int i = 0; i <= cells; ++i) {
        if (i < cells && border(across, line, i)) {
          continue;
        }
        if (i > start) {
          segments.push_back({point(across, line, start), point(across, line, i)});
        }
        start = i + 1;
      }
    }
  }
  return segments;
}

Expected<std::string> read_text_file(const std::string& path) {
  gzFile file = gzopen(path.c_str(), "rb");  // reads plain files too
  if (file == nullptr) {
    return failure(StatusCode::kNotFound,
                   fmt::format("{}: cannot open: {}; check the path", path, std::strerror(errno)));
  }
  std::string text;
  std::vector<char> buffer(std::size_t{1} << 18);
  int got = 0;
  while ((got = gzread(file, buffer.data(), static_cast<unsigned>(buffer.size()))) > 0) {
    text.append(buffer.data(), static_cast<std::size_t>(got));
    if (text.size() > kMaxFile_bytes) {
      gzclose(file);
      return failure(StatusCode::kInvalidArgument, path + ": larger than 256 MiB; give a smaller file");
    }
  }
  const bool whole = gzclose(file) == Z_OK && got == 0;
  if (!whole) {
    return failure(StatusCode::kCorrupt, path + ": cannot read to its end, damaged or cut short; make it again");
  }
  return text;
}

Expected<FloorPlan> load_floor_plan(const std::string& path, double resolution_m) {
  const bool csv = path.ends_with(".csv");
  if (!csv && !path.ends_with(".pgm") && !path.ends_with(".pgm.gz")) {
    return failure(StatusCode::kInvalidArgument,
                   path + ": unknown kind of world; give 'office' or a file .csv, .pgm or .pgm.gz");
  }
  const Expected<std::string> text = read_text_file(path);
  if (!text) {
    return failure(text.error());
  }
  if (csv) {
    auto walls = parse_wall_csv(*text, path);
    if (!walls) {
      return failure(walls.error());
    }
    const World world(std::move(*walls));
    return FloorPlan{world, world, {}};
  }
  auto map = parse_pgm(*text, path, resolution_m);
  if (!map) {
    return failure(map.error());
  }
  World world(outline(*map, &GreyMap::wall));
  World limits(outline(*map, &GreyMap::free));
  return FloorPlan{std::move(world), std::move(limits), std::move(*map)};
}

}  // namespace submapd::tools
