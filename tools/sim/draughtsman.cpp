#include "tools/sim/draughtsman.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "slam/base/random.hpp"

namespace submapd::tools {
namespace {

constexpr double kWall_m = 0.14;  // thickness of inner walls
constexpr double kPane_m = 2.4;
constexpr double kPost_m = 0.06;

}  // namespace

// While it lives, what is drawn belongs to one piece.
class Draughtsman::Drawing {
 public:
  explicit Drawing(Draughtsman& d) : d_(d), first_(d.segments_.size()) { ++d_.depth_; }
  Drawing(const Drawing&) = delete;
  Drawing& operator=(const Drawing&) = delete;
  ~Drawing() {
    --d_.depth_;
    if (d_.movable_ && d_.depth_ == 0) {
      d_.furniture_.emplace_back(first_, d_.segments_.size());
    }
  }

 private:
  Draughtsman& d_;
  std::size_t first_;
};

Opening door(double centre) {
  return {centre - 0.55, centre + 0.55, 0.0};
}

void Draughtsman::shape(double x, double y, const std::vector<Eigen::Vector2d>& outline, double yaw_deg) {
  const Drawing drawing(*this);
  const double c = std::cos(yaw_deg * std::numbers::pi / 180.0);
  const double s = std::sin(yaw_deg * std::numbers::pi / 180.0);
  std::vector<Eigen::Vector2d> corners;
  for (const Eigen::Vector2d& corner : outline) {
    corners.emplace_back(x + c * corner.x() - s * corner.y(), y + s * corner.x() + c * corner.y());
  }
  for (std::size_t i = 0; i < corners.size(); ++i) {
    line(corners[i], corners[(i + 1) % corners.size()]);
  }
}

void Draughtsman::box(double x, double y, double width, double depth, double yaw_deg) {
  shape(x, y, {{-width / 2, -depth / 2}, {width / 2, -depth / 2}, {width / 2, depth / 2}, {-width / 2, depth / 2}},
        yaw_deg);
}

void Draughtsman::round(double x, double y, double radius, int corners) {
  std::vector<Eigen::Vector2d> outline;
  for (int i = 0; i < corners; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / corners;
    outline.emplace_back(radius * std::cos(angle), radius * std::sin(angle));
  }
  shape(x, y, outline, 0.0);
}

void Draughtsman::wall(double at, double from, double to, const std::vector<Opening>& openings, bool vertical) {
  double start = from;
  const auto solid = [&](double a, double b, double centre, double thickness) {
    if (b - a < 1e-9) {
      return;
    }
    if (vertical) {
      box(centre, (a + b) / 2, thickness, b - a);
    } else {
      box((a + b) / 2, centre, b - a, thickness);
    }
  };
  for (const Opening& opening : openings) {
    solid(start, opening.from, at, kWall_m);
    if (opening.niche_m != 0.0) {
      const double middle = at + opening.niche_m / 2;
      solid(opening.from, opening.to, at + opening.niche_m, 0.1);
      solid(opening.from - 0.1, opening.from, middle, std::abs(opening.niche_m));
      solid(opening.to, opening.to + 0.1, middle, std::abs(opening.niche_m));
    } else {
      // Door frames stand out from the wall.
      solid(opening.from - 0.07, opening.from, at, kWall_m + 0.08);
      solid(opening.to, opening.to + 0.07, at, kWall_m + 0.08);
    }
    start = opening.to;
  }
  solid(start, to, at, kWall_m);
}

void Draughtsman::glass_front(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  const double length = (b - a).norm();
  if (length < 2.0 * kPost_m) {
    return;
  }
  const Eigen::Vector2d along = (b - a) / length;
  const double yaw_deg = std::atan2(along.y(), along.x()) * 180.0 / std::numbers::pi;
  const int panes = std::max(1, static_cast<int>(std::lround(length / kPane_m)));
  for (int i = 0; i <= panes; ++i) {
    const Eigen::Vector2d post = a + along * (length * i / panes);
    box(post.x(), post.y(), kPost_m, kPost_m, yaw_deg);
    if (i > 0) {
      line(a + along * (length * (i - 1) / panes + kPost_m / 2), post - along * kPost_m / 2, Surface::kGlass);
    }
  }
}

void Draughtsman::table(double x, double y, double width, double depth, double yaw_deg) {
  const Drawing drawing(*this);
  for (const double sx : {-0.5, 0.5}) {
    for (const double sy : {-0.5, 0.5}) {
      part(x, y, sx * (width - 0.1), sy * (depth - 0.1), 0.05, 0.05, yaw_deg);
    }
  }
}

void Draughtsman::desk(double x, double y, double yaw_deg) {
  const Drawing drawing(*this);
  table(x, y, 1.6, 0.8, yaw_deg);
  part(x, y, 0.5, 0.05, 0.42, 0.58, yaw_deg);
  part(x, y, -0.1, 0.36, 0.7, 0.03, yaw_deg);
}

void Draughtsman::office_chair(double x, double y, double yaw_deg) {
  const Drawing drawing(*this);
  round(x, y, 0.04, 6);
  for (int i = 0; i < 5; ++i) {
    const double angle = (yaw_deg + 72.0 * i) * std::numbers::pi / 180.0;
    box(x + 0.27 * std::cos(angle), y + 0.27 * std::sin(angle), 0.06, 0.05, yaw_deg + 72.0 * i);
  }
}

void Draughtsman::conference_table(double x, double y, double width, double depth, int chairs_a_side) {
  const Drawing drawing(*this);
  box(x - width / 4, y, 0.5, 0.3);
  box(x + width / 4, y, 0.5, 0.3);
  for (int i = 0; i < chairs_a_side; ++i) {
    const double along = x - width / 2 + width * (i + 0.5) / chairs_a_side;
    chair(along, y - depth / 2 - 0.2 - 0.05 * (i % 3), 7.0 * i - 10.0);
    chair(along + 0.07, y + depth / 2 + 0.25 + 0.04 * (i % 2), 13.0 - 9.0 * i);
  }
}

void Draughtsman::copy(const std::vector<Segment>& segments, const Eigen::Vector2d& offset) {
  for (const Segment& segment : segments) {
    line(segment.a + offset, segment.b + offset, segment.surface);
  }
}

void Draughtsman::part(double x, double y, double dx, double dy, double width, double depth, double yaw_deg) {
  const double c = std::cos(yaw_deg * std::numbers::pi / 180.0);
  const double s = std::sin(yaw_deg * std::numbers::pi / 180.0);
  box(x + c * dx - s * dy, y + s * dx + c * dy, width, depth, yaw_deg);
}

std::vector<Segment> move_furniture(const std::vector<Segment>& walls, const std::vector<Piece>& furniture,
                                    std::uint64_t seed) {
  constexpr std::uint64_t kStream = 0x4D4F5645;
  constexpr double kGone = 0.1;
  constexpr double kMoved = 0.25;
  constexpr double kFarthest_m = 0.3;
  std::vector<Segment> later;
  std::size_t next = 0;
  for (std::size_t i = 0; i < furniture.size(); ++i) {
    const auto [first, last] = furniture[i];
    CounterRandom random(seed, kStream, i);
    const double draw = random.uniform();
    const double angle = random.uniform(0.0, 2.0 * std::numbers::pi);
    const double way_m = draw < kGone + kMoved ? random.uniform(0.05, kFarthest_m) : 0.0;
    const Eigen::Vector2d shift = way_m * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    later.insert(later.end(), walls.begin() + static_cast<std::ptrdiff_t>(next),
                 walls.begin() + static_cast<std::ptrdiff_t>(first));
    for (std::size_t k = draw < kGone ? last : first; k < last; ++k) {
      later.push_back({walls[k].a + shift, walls[k].b + shift, walls[k].surface});
    }
    next = last;
  }
  later.insert(later.end(), walls.begin() + static_cast<std::ptrdiff_t>(next), walls.end());
  return later;
}

}  // namespace submapd::tools
