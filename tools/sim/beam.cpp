#include "tools/sim/beam.hpp"

#include <cmath>

namespace submapd::tools {
namespace {

constexpr int kMostSurfaces = 8;          // a beam between two mirrors is lost after so many
constexpr double kGlassCosine = 0.99756;  // 4 deg
constexpr double kGlassHeadOn = 0.08;     // share that both faces of a pane reflect head on
constexpr double kOffSurface_m = 1e-5;    // the way goes on so far behind a surface

std::optional<Echo> meet(const Disc& disc, double time_s, const Eigen::Vector2d& origin,
                         const Eigen::Vector2d& direction) {
  const Eigen::Vector2d to_centre = disc.centre + time_s * disc.velocity - origin;
  const double along = to_centre.dot(direction);
  const double miss2 = to_centre.squaredNorm() - along * along;
  const double radius2 = disc.radius_m * disc.radius_m;
  if (along <= 0.0 || miss2 >= radius2 || to_centre.squaredNorm() <= radius2) {
    return std::nullopt;
  }
  const double half_chord = std::sqrt(radius2 - miss2);
  return Echo{along - half_chord, half_chord / disc.radius_m};
}

}  // namespace

std::optional<Echo> trace(const World& world, std::span<const Disc> people, double time_s,
                          const Eigen::Vector2d& origin, const Eigen::Vector2d& direction, double range_max_m,
                          CounterRandom& random) {
  Eigen::Vector2d from = origin;
  Eigen::Vector2d towards = direction;
  double way_m = 0.0;
  for (int surface = 0; surface < kMostSurfaces; ++surface) {
    const std::optional<RayHit> wall = world.cast(from, towards, range_max_m - way_m);
    std::optional<Echo> person;
    double nearest_m = wall ? wall->range_m : range_max_m - way_m;
    for (const Disc& disc : people) {
      if (const auto met = meet(disc, time_s, from, towards); met && met->range_m < nearest_m) {
        nearest_m = met->range_m;
        person = met;
      }
    }
    if (person) {
      return Echo{way_m + person->range_m, person->cos_incidence};
    }
    if (!wall) {
      return std::nullopt;
    }
    const Segment& segment = world.segments()[wall->segment];
    const bool answers = segment.surface == Surface::kMatt ||
                         (segment.surface == Surface::kGlass && wall->cos_incidence >= kGlassCosine);
    if (answers) {
      return Echo{way_m + wall->range_m, wall->cos_incidence};
    }
    const double share = segment.surface == Surface::kMirror
                             ? 1.0
                             : kGlassHeadOn + (1.0 - kGlassHeadOn) * std::pow(1.0 - wall->cos_incidence, 5);
    from += towards * wall->range_m;
    if (share >= 1.0 || random.uniform() < share) {
      const Eigen::Vector2d along = (segment.b - segment.a).normalized();
      towards = 2.0 * towards.dot(along) * along - towards;
    }
    from += towards * kOffSurface_m;
    way_m += wall->range_m + kOffSurface_m;
    if (way_m >= range_max_m) {
      return std::nullopt;
    }
  }
  return std::nullopt;
}

}  // namespace submapd::tools
