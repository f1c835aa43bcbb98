#include "slam/matching/line_matcher.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace submapd {
namespace {

constexpr float kPerFar_m = 0.1F;  // beyond 10 m ranges err more, by data sheets

const PooledLine* line_at(const SurfaceMap& surface, LinesOf lines, float x, float y, const SurfaceLook& look) {
  return lines == LinesOf::kCell ? surface.find(x, y, look) : surface.find_pooled(x, y, look);
}

// The lines found last, by point: from pass to pass a point moves by millimetres and hardly ever into another cell.
class FoundLines {
 public:
  template <typename Find>
  const PooledLine* at(std::size_t point, int cell, const Find& find) {
    if (point >= known_.size()) return find();
    if (point >= used_) {
      for (; used_ <= point; ++used_) known_[used_].cell = kNoCell;
    }
    Known& known = known_[point];
    if (known.cell != cell) known = {find(), cell};
    return known.line;
  }

 private:
  static constexpr int kNoCell = -2;
  struct Known {
    const PooledLine* line;
    int cell;
  };
  std::array<Known, 1100> known_;  // on the stack; scans of more beams ask again for the rest
  std::size_t used_ = 0;
};

// `find(point, x, y, look)` gives the line that a point belongs to, by its number and its place on the map.
template <typename Find>
LineSystem system_at(std::span<const ScanPoint> points, int scans, double angle_step_rad, const Pose2& pose,
                     const WeakMotion& weak_motion, const LineMatcherOptions& options, const Find& find) {
  LineSystem out;
  const int standing = std::min(options.standing_scans, scans);
  const bool weak = weak_motion.any();
  const auto ax = static_cast<float>(weak_motion.axis.x());
  const auto ay = static_cast<float>(weak_motion.axis.y());
  const auto turn = static_cast<float>(weak_motion.turn_rad_m);
  const auto facing = static_cast<float>(options.facing);
  const auto c = static_cast<float>(std::cos(pose.yaw));
  const auto s = static_cast<float>(std::sin(pose.yaw));
  const auto tx = static_cast<float>(pose.x);
  const auto ty = static_cast<float>(pose.y);
  const auto near_sigma = static_cast<float>(options.range_sigma_m);
  const auto beam_sigma = static_cast<float>(options.beam_sigma_steps * angle_step_rad);
  const auto min_var = static_cast<float>(options.min_line_sigma_m * options.min_line_sigma_m);
  const auto gate = static_cast<float>(options.gate_m);
  const auto min_gate = static_cast<float>(options.min_gate_m);
  const auto tangential_gate = static_cast<float>(options.tangential_gate_m);
  const auto inverse_c2 = static_cast<float>(1.0 / (options.cauchy_sigmas * options.cauchy_sigmas));
  for (std::size_t i = 0; i < points.size(); ++i) {
    const ScanPoint& p = points[i];
    const float rx = c * p.x - s * p.y;
    const float ry = s * p.x + c * p.y;
    const float x = tx + rx;
    const float y = ty + ry;
    const float vx = c * p.view_x - s * p.view_y;
    const float vy = s * p.view_x + c * p.view_y;
    const SurfaceLook look{vx, vy, c * p.normal_x - s * p.normal_y, s * p.normal_x + c * p.normal_y};
    const PooledLine* line = find(i, x, y, look);
    if (line == nullptr) continue;
    const float dx = x - line->mean_x;
    const float dy = y - line->mean_y;
    const float range_sigma = near_sigma * std::max(1.0F, p.range_m * kPerFar_m);
    const float range_var = range_sigma * range_sigma;
    const float map_var = line->sigma_m * line->sigma_m / line->count + min_var;
    const float cross = p.range_m * beam_sigma;
    if (line->kind == SurfaceKind::kLine) {
      const float nx = line->normal_x;
      const float ny = line->normal_y;
      const float along_ray = nx * vx + ny * vy;
      const float excess = std::max(line->sigma_m * line->sigma_m - range_var, 0.0F);
      const float var =
          excess + range_var * along_ray * along_ray + map_var + cross * cross * (1.0F - along_ray * along_ray);
      const float r = nx * dx + ny * dy;
      const float limit = std::max(min_gate, std::min(gate, 3.0F * std::sqrt(var + line->sigma_m * line->sigma_m)));
      if (std::abs(r) > limit || std::abs(ny * dx - nx * dy) > tangential_gate) continue;
      ++out.associated;
      const float w = p.weight / (var * (1.0F + r * r / var * inverse_c2));
      float jx = nx;
      float jy = ny;
      const float jw = -nx * ry + ny * rx;
      if (weak) {
        // What is taken off leaves a row that does not change with the weak motion.
        const float along = nx * ax + ny * ay + jw * turn;
        if (std::abs(along) < facing || line->scans < standing || line->moved || p.alone) {
          jx -= along * ax;
          jy -= along * ay;
        } else {
          out.axial_information += static_cast<double>(w * along * along);
        }
      }
      out.equations.add(static_cast<double>(jx), static_cast<double>(jy), static_cast<double>(jw),
                        static_cast<double>(r), static_cast<double>(w));
    } else {
      const float var = range_var + map_var + cross * cross + 2.0F * line->sigma_m * line->sigma_m + 4e-4F;
      const float r2 = dx * dx + dy * dy;
      if (r2 > gate * gate) continue;
      ++out.associated;
      const float w = p.weight / (var * (1.0F + r2 / var * inverse_c2));
      if (weak) {
        // Hits too sparse for a line lie where this scan's beams fall: across the axis they tell, along it they follow.
        const float across = -ay * dx + ax * dy;
        const float jw = ay * ry + ax * rx;
        out.equations.add(static_cast<double>(-ay - jw * turn * ax), static_cast<double>(ax - jw * turn * ay),
                          static_cast<double>(jw), static_cast<double>(across), static_cast<double>(w));
        continue;
      }
      out.equations.add(1.0, 0.0, static_cast<double>(-ry), static_cast<double>(dx), static_cast<double>(w));
      out.equations.add(0.0, 1.0, static_cast<double>(rx), static_cast<double>(dy), static_cast<double>(w));
    }
  }
  out.equations.complete();
  return out;
}

}  // namespace

LineSystem line_system(std::span<const ScanPoint> points, const SurfaceMap& surface, double angle_step_rad,
                       const Pose2& pose, const WeakMotion& weak_motion, const LineMatcherOptions& options) {
  return system_at(points, surface.scans(), angle_step_rad, pose, weak_motion, options,
                   [&](std::size_t, float x, float y, const SurfaceLook& look) {
                     return line_at(surface, options.lines, x, y, look);
                   });
}

LineMatchResult match_lines(std::span<const ScanPoint> points, const SurfaceMap& surface, double angle_step_rad,
                            const Pose2& start, const MotionPrior& prior, const LineMatcherOptions& options) {
  LineMatchResult result;
  result.match.pose = start;
  if (points.empty()) return result;
  FoundLines found;
  const auto find = [&](std::size_t i, float x, float y, const SurfaceLook& look) {
    return found.at(i, SurfaceMap::cell_of(x, y), [&] { return line_at(surface, options.lines, x, y, look); });
  };
  for (int pass = 0;; ++pass) {
    const LineSystem system =
        system_at(points, surface.scans(), angle_step_rad, result.match.pose, prior.weak, options, find);
    result.match.information = system.equations.H;
    result.associated = system.associated;
    result.match.health.iterations = pass;
    if (pass == options.max_iterations) break;
    const Eigen::Vector3d step = solve_step(system.equations, options.kappa, result.match.pose, prior);
    result.match.pose.x += step(0);
    result.match.pose.y += step(1);
    result.match.pose.yaw += step(2);
    if (step.head<2>().norm() < options.stop_m && std::abs(step(2)) < options.stop_rad) break;
  }
  result.match.health.line_ratio = static_cast<double>(result.associated) / static_cast<double>(points.size());
  return result;
}

}  // namespace submapd
