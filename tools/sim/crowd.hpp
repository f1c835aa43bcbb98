// People who walk through a world: where each is at any time, as discs that a laser sees.
//
// A person goes to and fro along one walkway, at a pace of one's own, slowing to a halt now and then, and steps aside
// for the cart. Companions go along with the cart, ahead of it, beside it and behind. Positions have a closed form in
// time: same walkways, number and seed, same people. Immutable.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "tools/sim/motion.hpp"

namespace submapd::tools {

// Where people walk: a line, and how far to its sides.
struct Walkway {
  std::vector<Eigen::Vector2d> points;  // m, in the world's frame
  double half_width_m = 1.0;
};

struct Disc {
  Eigen::Vector2d centre;
  Eigen::Vector2d velocity;  // m/s
  double radius_m = 0.0;
};

class Crowd {
 public:
  // Walkways get people in proportion to their lengths. No walkway, nobody.
  Crowd(const std::vector<Walkway>& walkways, int people, std::uint64_t seed);

  // Replaces `seen` by the people within reach of the cart at a time since the start.
  void near(double time_s, const Eigen::Vector2d& cart, double reach_m, std::vector<Disc>& seen) const;

  // REQUIRES: motion outlives this.
  void accompany(const Motion& motion, int companions, std::uint64_t seed);

  [[nodiscard]] std::size_t size() const { return people_.size() + companions_.size(); }

 private:
  struct Companion {
    double ahead_s = 0.0;  // where the cart will be by then, or was
    double aside_m = 0.0;
    double sway_m = 0.0;
    double period_s = 5.0;
    double radius_m = 0.2;
  };
  struct Person {
    std::uint32_t walkway = 0;
    double start_m = 0.0;
    double pace_m_s = 1.2;
    double hesitation = 0.0;  // 0: steady; 1: comes to a halt once in a period
    double period_s = 20.0;
    double phase_rad = 0.0;
    double aside_m = 0.0;
    double radius_m = 0.2;
  };
  [[nodiscard]] Eigen::Vector2d place(const Person& person, double time_s) const;
  [[nodiscard]] Eigen::Vector2d place(const Companion& companion, double time_s) const;
  template <typename Anybody>
  void add_seen(const std::vector<Anybody>& group, double time_s, const Eigen::Vector2d& cart, double reach_m,
                std::vector<Disc>& seen) const;

  std::vector<Walkway> walkways_;
  std::vector<std::vector<double>> arc_m_;  // of each walkway's points
  std::vector<Person> people_;
  std::vector<Companion> companions_;
  const Motion* motion_ = nullptr;
};

}  // namespace submapd::tools
