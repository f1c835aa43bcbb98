#include "tools/sim/crowd.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "slam/base/random.hpp"

namespace submapd::tools {
namespace {

constexpr std::uint64_t kCrowdStream = 0x43524F5744;
constexpr std::uint64_t kCompanyStream = 0x434F4D50;
constexpr double kStep_s = 0.02;   // for velocities
constexpr double kAside_m = 0.85;  // people keep this far from the cart's middle

Eigen::Vector2d step_aside(const Eigen::Vector2d& person, const Eigen::Vector2d& cart) {
  const Eigen::Vector2d from_cart = person - cart;
  const double distance = from_cart.norm();
  if (distance >= kAside_m) {
    return person;
  }
  return distance < 1e-6 ? Eigen::Vector2d(cart + Eigen::Vector2d(kAside_m, 0.0))
                         : Eigen::Vector2d(cart + from_cart * (kAside_m / distance));
}

}  // namespace

Crowd::Crowd(const std::vector<Walkway>& walkways, int people, std::uint64_t seed) : walkways_(walkways) {
  double whole_m = 0.0;
  for (const Walkway& walkway : walkways_) {
    std::vector<double> arc{0.0};
    for (std::size_t i = 1; i < walkway.points.size(); ++i) {
      arc.push_back(arc.back() + (walkway.points[i] - walkway.points[i - 1]).norm());
    }
    whole_m += arc.back();
    arc_m_.push_back(std::move(arc));
  }
  if (whole_m <= 0.0) {
    return;
  }
  for (int i = 0; i < people; ++i) {
    CounterRandom random(seed, kCrowdStream, static_cast<std::uint64_t>(i));
    Person person;
    double along_m = random.uniform(0.0, whole_m);
    while (person.walkway + 1 < walkways_.size() && along_m > arc_m_[person.walkway].back()) {
      along_m -= arc_m_[person.walkway].back();
      ++person.walkway;
    }
    const double reach_m = walkways_[person.walkway].half_width_m;
    person.start_m = along_m + (random.uniform() < 0.5 ? arc_m_[person.walkway].back() : 0.0);
    person.pace_m_s = random.uniform(0.4, 1.6);
    person.hesitation = random.uniform() < 0.5 ? 1.0 : random.uniform(0.0, 0.5);
    person.period_s = random.uniform(8.0, 40.0);
    person.phase_rad = random.uniform(0.0, 2.0 * std::numbers::pi);
    person.aside_m = random.uniform(-reach_m, reach_m);
    person.radius_m = random.uniform(0.15, 0.26);
    people_.push_back(person);
  }
}

Eigen::Vector2d Crowd::place(const Person& person, double time_s) const {
  const std::vector<Eigen::Vector2d>& points = walkways_[person.walkway].points;
  const std::vector<double>& arc = arc_m_[person.walkway];
  const double rate = 2.0 * std::numbers::pi / person.period_s;
  const double walked_m = person.start_m + person.pace_m_s * (time_s + person.hesitation / rate *
                                                                           std::sin(rate * time_s + person.phase_rad));
  double along_m = std::fmod(walked_m, 2.0 * arc.back());
  along_m += along_m < 0.0 ? 2.0 * arc.back() : 0.0;
  const bool back = along_m > arc.back();
  along_m = back ? 2.0 * arc.back() - along_m : along_m;
  const auto after = std::upper_bound(arc.begin() + 1, arc.end() - 1, along_m);
  const auto i = static_cast<std::size_t>(after - arc.begin());
  const Eigen::Vector2d direction = (points[i] - points[i - 1]) / std::max(arc[i] - arc[i - 1], 1e-9);
  return points[i - 1] + direction * (along_m - arc[i - 1]) +
         Eigen::Vector2d(-direction.y(), direction.x()) * person.aside_m;
}

void Crowd::accompany(const Motion& motion, int companions, std::uint64_t seed) {
  motion_ = &motion;
  for (int i = 0; i < companions; ++i) {
    CounterRandom random(seed, kCompanyStream, static_cast<std::uint64_t>(i));
    Companion companion;
    companion.ahead_s = random.uniform(-1.0, 2.0);
    companion.aside_m = random.uniform(0.2, 1.6) * (i % 2 == 0 ? 1.0 : -1.0);
    companion.sway_m = random.uniform(0.1, 0.4);
    companion.period_s = random.uniform(3.0, 9.0);
    companion.radius_m = random.uniform(0.15, 0.26);
    companions_.push_back(companion);
  }
}

Eigen::Vector2d Crowd::place(const Companion& companion, double time_s) const {
  const Pose2 cart = motion_->at(time_s + companion.ahead_s);
  const double phase = 2.0 * std::numbers::pi * time_s / companion.period_s;
  // Some way before or behind it, even when it stands.
  const double along_m = companion.ahead_s + companion.sway_m * std::cos(phase);
  return compose(cart, {along_m, companion.aside_m + companion.sway_m * std::sin(phase), 0.0}).translation();
}

template <typename Anybody>
void Crowd::add_seen(const std::vector<Anybody>& group, double time_s, const Eigen::Vector2d& cart, double reach_m,
                     std::vector<Disc>& seen) const {
  for (const Anybody& person : group) {
    const Eigen::Vector2d now = place(person, time_s);
    if ((now - cart).norm() > reach_m) {
      continue;
    }
    const Eigen::Vector2d centre = step_aside(now, cart);
    const Eigen::Vector2d next = step_aside(place(person, time_s + kStep_s), cart);
    Eigen::Vector2d velocity = (next - centre) / kStep_s;
    constexpr double kFastest_m_s = 4.0;  // round a corner of the walkway, people do not jump within a sweep
    velocity *= std::min(1.0, kFastest_m_s / std::max(velocity.norm(), 1e-9));
    seen.push_back({centre, velocity, person.radius_m});
  }
}

void Crowd::near(double time_s, const Eigen::Vector2d& cart, double reach_m, std::vector<Disc>& seen) const {
  seen.clear();
  add_seen(people_, time_s, cart, reach_m, seen);
  add_seen(companions_, time_s, cart, reach_m, seen);
}

}  // namespace submapd::tools
