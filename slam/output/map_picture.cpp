#include "slam/output/map_picture.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "slam/output/internal/canvas.hpp"
#include "slam/output/internal/font.hpp"
#include "slam/output/internal/map_view.hpp"
#include "slam/output/internal/png_file.hpp"

namespace submapd {
namespace {

using Eigen::Vector2d;
using internal::Canvas;
using internal::Color;
using internal::MapView;

constexpr std::size_t kCrowdedLoops = 25;  // more are drawn as hairlines under the path
constexpr Color kPaper{255, 255, 255};
constexpr Color kInk{36, 40, 48};
constexpr Color kFaint{112, 118, 128};
constexpr Color kRule{168, 174, 182};
constexpr Color kConfirmed{0, 150, 82};
constexpr Color kPending{222, 30, 44};
constexpr Color kAxes{36, 64, 110};
constexpr std::array<Color, 3> kPathColors{{{28, 84, 232}, {176, 40, 196}, {248, 136, 8}}};  // start, middle, end

// Sizes that grow with the picture, in pixels.
struct Sizes {
  double unit;  // 1 for a panel of 1200 pixels
  double dot() const { return 1.5 * unit; }
  double stroke() const { return 1.25 * unit; }
  double title_dot() const { return 2.3 * unit; }
  double title_stroke() const { return 2.3 * unit; }
  double pad() const { return 16.0 * unit; }
  double text_height() const { return internal::kCapitalRows * dot(); }
  double row() const { return 24.0 * unit; }  // of the legend
};

Color path_color(double share) {
  const double s = std::clamp(share, 0.0, 1.0) * 2.0;
  return s < 1.0 ? mix(kPathColors[0], kPathColors[1], s) : mix(kPathColors[1], kPathColors[2], s - 1.0);
}

void draw_path(Canvas& canvas, const MapView& view, const Sizes& sizes, std::span<const Pose2> path) {
  // A point a pixel suffices, however many poses there are.
  Vector2d last = path.empty() ? Vector2d::Zero() : view.to_pixel(path.front().translation());
  for (std::size_t i = 1; i < path.size(); ++i) {
    const Vector2d point = view.to_pixel(path[i].translation());
    if ((point - last).squaredNorm() < 1.0 && i + 1 < path.size()) continue;
    canvas.line(last, point, 1.8 * sizes.unit,
                path_color(static_cast<double>(i) / static_cast<double>(path.size() - 1)));
    last = point;
  }
}

void draw_start(Canvas& canvas, const Sizes& sizes, const Vector2d& at) {
  canvas.disc(at, 6.5 * sizes.unit, kPaper);
  canvas.disc(at, 5.0 * sizes.unit, kPathColors.front());
}

void draw_end(Canvas& canvas, const Sizes& sizes, const Vector2d& at) {
  canvas.disc(at, 7.0 * sizes.unit, kPaper);
  canvas.disc(at, 5.5 * sizes.unit, kPathColors.back());
  canvas.disc(at, 2.6 * sizes.unit, kPaper);
}

// `crowded`: hairlines, so that the map shows through hundreds of loops.
void draw_loop(Canvas& canvas, const Sizes& sizes, const Vector2d& from, const Vector2d& to, bool confirmed,
               bool crowded) {
  const double width = 1.7 * sizes.unit;
  const double halo = width + 2.0 * sizes.unit;
  const double dash = 7.0 * sizes.unit;
  if (crowded) {
    const double hairline = 0.3 * sizes.unit;
    confirmed ? canvas.line(from, to, hairline, kConfirmed) : canvas.dashed_line(from, to, hairline, dash, kPending);
  } else if (confirmed) {
    canvas.line(from, to, halo, kPaper);
    canvas.line(from, to, width, kConfirmed);
  } else {
    canvas.dashed_line(from, to, halo, dash, kPaper);
    canvas.dashed_line(from, to, width, dash, kPending);
  }
}

// Long tick along x, short one along y.
void draw_axes(Canvas& canvas, const Sizes& sizes, const Vector2d& at, double yaw_rad) {
  const Vector2d x_axis(std::cos(yaw_rad), -std::sin(yaw_rad));  // rows grow downwards
  const Vector2d y_axis(x_axis.y(), -x_axis.x());
  const double width = 1.5 * sizes.unit;
  canvas.line(at, at + 11.0 * sizes.unit * x_axis, width + 2.0 * sizes.unit, kPaper);
  canvas.line(at, at + 6.0 * sizes.unit * y_axis, width + 2.0 * sizes.unit, kPaper);
  canvas.line(at, at + 11.0 * sizes.unit * x_axis, width, kAxes);
  canvas.line(at, at + 6.0 * sizes.unit * y_axis, width, kAxes);
}

// Index beside each sub-map's origin, left out where it would cover an earlier one.
void draw_submap_labels(Canvas& canvas, const MapView& view, const Sizes& sizes, std::span<const SubmapMark> submaps) {
  struct Box {
    Vector2d low;
    Vector2d high;
  };
  std::vector<Box> taken;
  for (const SubmapMark& submap : submaps) {
    const std::string label = fmt::format("{}", submap.index);
    const Vector2d low = view.to_pixel(submap.map_from_submap.translation()) + sizes.unit * Vector2d(6.0, 5.0);
    const Vector2d high = low + Vector2d(internal::text_width_dots(label) * sizes.dot(), sizes.text_height());
    const bool covers = std::any_of(taken.begin(), taken.end(), [&](const Box& box) {
      return (low.array() < box.high.array() + 2.0).all() && (box.low.array() < high.array() + 2.0).all();
    });
    if (covers) continue;
    taken.push_back({low, high});
    canvas.text(low, label, sizes.dot(), sizes.stroke() + 3.0 * sizes.unit, kPaper);
    canvas.text(low, label, sizes.dot(), sizes.stroke(), kAxes);
  }
}

// The longest round length of at most a quarter of the panel.
int scale_bar_m(const MapView& view) {
  int length_m = 1;
  for (const int candidate_m : {2, 5, 10, 20, 50}) {
    if (candidate_m * view.px_per_m() <= view.width / 4.0) length_m = candidate_m;
  }
  return length_m;
}

// One entry of the bar below the map: a picture of `symbol_px` and a label right of it.
struct LegendItem {
  double symbol_px;
  std::string label;
  std::function<void(Canvas&, const Vector2d&)> draw;  // at the symbol's left end, middle height
};

std::vector<LegendItem> legend_items(const MapView& view, const Sizes& sizes, const PictureInput& input) {
  const double u = sizes.unit;
  std::vector<LegendItem> items;
  const int bar_m = scale_bar_m(view);
  const double bar_px = bar_m * view.px_per_m();
  items.push_back({bar_px, fmt::format("{} m", bar_m), [bar_px, u](Canvas& canvas, const Vector2d& at) {
                     const Vector2d end = at + Vector2d(bar_px, 0.0);
                     canvas.line(at, end, 2.0 * u, kInk);
                     for (const Vector2d& tick : {at, end}) {
                       canvas.line(tick - Vector2d(0.0, 5.0 * u), tick + Vector2d(0.0, 5.0 * u), 2.0 * u, kInk);
                     }
                   }});
  if (!input.path.empty()) {
    items.push_back({58.0 * u, "path, start to end", [&sizes, u](Canvas& canvas, const Vector2d& left) {
                       const Vector2d at = left + Vector2d(5.0 * u, 0.0);
                       for (int i = 0; i < 48; ++i) {
                         canvas.line(at + Vector2d(i * u, 0.0), at + Vector2d((i + 1) * u, 0.0), 1.8 * u,
                                     path_color(i / 47.0));
                       }
                       draw_start(canvas, sizes, at);
                       draw_end(canvas, sizes, at + Vector2d(48.0 * u, 0.0));
                     }});
  }
  if (!input.submaps.empty()) {
    items.push_back({12.0 * u, "sub-map", [&sizes, u](Canvas& canvas, const Vector2d& at) {
                       draw_axes(canvas, sizes, at + Vector2d(0.0, 3.0 * u), 0.0);
                     }});
  }
  for (const bool confirmed : {true, false}) {
    const auto same = [confirmed](const LoopMark& loop) { return loop.confirmed == confirmed; };
    if (std::none_of(input.loops.begin(), input.loops.end(), same)) continue;
    items.push_back(
        {30.0 * u, confirmed ? "loop" : "pending loop", [&sizes, u, confirmed](Canvas& canvas, const Vector2d& at) {
           draw_loop(canvas, sizes, at, at + Vector2d(30.0 * u, 0.0), confirmed, false);
         }});
  }
  const std::array<std::pair<const char*, Color>, 3> areas{
      {{"wall", internal::kWallColor}, {"free", internal::kFreeColor}, {"unknown", internal::kUnknownColor}}};
  for (const auto& [label, color] : areas) {
    items.push_back({12.0 * u, label, [u, fill = color](Canvas& canvas, const Vector2d& at) {
                       const Vector2d low = at - Vector2d(0.0, 6.0 * u);
                       const Vector2d high = at + Vector2d(12.0 * u, 6.0 * u);
                       const auto box = [&](double inset, Color paint) {
                         canvas.rectangle(static_cast<int>(low.x() + inset), static_cast<int>(low.y() + inset),
                                          static_cast<int>(high.x() - inset), static_cast<int>(high.y() - inset),
                                          paint);
                       };
                       box(0.0, kRule);
                       box(std::max(1.0, std::floor(u)), fill);
                     }});
  }
  return items;
}

// Lays the items out in rows of `width_px`; draws them from `top` on if there is a canvas. Returns the height of the
// rows.
double legend(Canvas* canvas, std::span<const LegendItem> items, const Sizes& sizes, double width_px, double top) {
  const double gap = 7.0 * sizes.unit;
  Vector2d at(sizes.pad(), top);
  for (const LegendItem& item : items) {
    const double label_px = internal::text_width_dots(item.label) * sizes.dot();
    const double item_px = item.symbol_px + gap + label_px;
    if (at.x() > sizes.pad() && at.x() + item_px > width_px - sizes.pad()) at = {sizes.pad(), at.y() + sizes.row()};
    if (canvas != nullptr) {
      const Vector2d middle(at.x(), at.y() + sizes.row() / 2.0);
      item.draw(*canvas, middle);
      const Vector2d label_at = middle + Vector2d(item.symbol_px + gap, -sizes.text_height() / 2.0);
      canvas->text(label_at, item.label, sizes.dot(), sizes.stroke(), kInk);
    }
    at.x() += item_px + 21.0 * sizes.unit;
  }
  return at.y() + sizes.row() - top;
}

// A line of text made smaller, then cut, until it fits the width.
void fitted_text(Canvas& canvas, const Vector2d& at, std::string text, double dot, double stroke, double width_px,
                 Color color) {
  const double least_dot = 0.5 * dot;
  const double fitting_dot = width_px / std::max(1.0, internal::text_width_dots(text));
  const double used_dot = std::clamp(fitting_dot, least_dot, dot);
  if (fitting_dot < least_dot) {
    while (!text.empty() && internal::text_width_dots(text + "...") * used_dot > width_px) text.pop_back();
    text += "...";
  }
  canvas.text(at, text, used_dot, stroke * used_dot / dot, color);
}

}  // namespace

std::string picture_title(std::string_view name, double length_m, std::size_t submaps, std::size_t loops) {
  return fmt::format("{} - {:.0f} m, {} sub-map{}, {} loop{}", name, length_m, submaps, submaps == 1 ? "" : "s", loops,
                     loops == 1 ? "" : "s");
}

Status write_map_picture(const std::filesystem::path& path, const PictureInput& input) {
  if (Status status = check_map_image(input.map); !status.ok()) {
    return Status(status.code(), path.string() + ": " + status.message());
  }
  MapView view = internal::fit_view(input.map, input.path);
  const Sizes sizes{std::clamp(std::max(view.width, view.height) / 1200.0, 0.9, 1.6)};
  const std::vector<LegendItem> items = legend_items(view, sizes, input);
  const double subtitle_px = input.subtitle.empty() ? 0.0 : 9.0 * sizes.unit + sizes.text_height();
  const double header_px = 2.0 * sizes.pad() + internal::kCapitalRows * sizes.title_dot() + subtitle_px;
  const double legend_px = legend(nullptr, items, sizes, view.width, 0.0);
  view.top = static_cast<int>(header_px);
  const int footer_top = view.top + view.height;

  Canvas canvas(view.width, footer_top + static_cast<int>(legend_px + sizes.pad()), kPaper);
  internal::paint_map(canvas, view, input.map);
  const bool crowded = input.loops.size() > kCrowdedLoops;
  if (!crowded) draw_path(canvas, view, sizes, input.path);
  for (const LoopMark& loop : input.loops) {
    draw_loop(canvas, sizes, view.to_pixel(loop.from), view.to_pixel(loop.to), loop.confirmed, crowded);
  }
  if (crowded) draw_path(canvas, view, sizes, input.path);
  for (const SubmapMark& submap : input.submaps) {
    draw_axes(canvas, sizes, view.to_pixel(submap.map_from_submap.translation()), submap.map_from_submap.yaw);
  }
  draw_submap_labels(canvas, view, sizes, input.submaps);
  if (!input.path.empty()) {
    draw_start(canvas, sizes, view.to_pixel(input.path.front().translation()));
    draw_end(canvas, sizes, view.to_pixel(input.path.back().translation()));
  }

  // The bands go over what may stick out of the panel.
  const int rule_px = std::max(1, static_cast<int>(sizes.unit));
  canvas.rectangle(0, 0, canvas.width(), view.top, kPaper);
  canvas.rectangle(0, footer_top, canvas.width(), canvas.height(), kPaper);
  canvas.rectangle(0, view.top - rule_px, canvas.width(), view.top, kRule);
  canvas.rectangle(0, footer_top, canvas.width(), footer_top + rule_px, kRule);
  const double text_px = canvas.width() - 2.0 * sizes.pad();
  Vector2d at(sizes.pad(), sizes.pad());
  fitted_text(canvas, at, input.title, sizes.title_dot(), sizes.title_stroke(), text_px, kInk);
  at.y() += internal::kCapitalRows * sizes.title_dot() + 9.0 * sizes.unit;
  fitted_text(canvas, at, input.subtitle, sizes.dot(), sizes.stroke(), text_px, kFaint);
  legend(&canvas, items, sizes, view.width, footer_top + sizes.pad() / 2.0);

  const double m_per_px = 1.0 / view.px_per_m();
  const Vector2d origin = view.lower_left_m() - Vector2d(0.0, (canvas.height() - footer_top) * m_per_px);
  const std::array<internal::PngText, 4> texts{{{"Title", input.title},
                                                {"Software", input.subtitle},
                                                {"Resolution", fmt::format("{:.9g}", m_per_px)},
                                                {"Origin", fmt::format("{:.6f} {:.6f}", origin.x(), origin.y())}}};
  return internal::write_png(path, canvas, texts);
}

}  // namespace submapd
