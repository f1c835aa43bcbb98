// The latched degenerate state: a direction that no wall holds is not corrected by noise (design notes 5.4).
#pragma once

#include <Eigen/Core>
#include <array>

#include "slam/base/pose2.hpp"

namespace submapd {

struct DegeneracyOptions {
  double enter_ratio = 0.1;  // smaller to larger eigenvalue of the translation block, noise floor taken off
  double leave_ratio = 0.2;
  double round_ratio = 0.02;          // below it the way round goes before the way straight ahead
  double least_turn_rad_m = 0.03;     // of a round corridor: radius of 33 m at most
  int leave_scans = 8;                // in a row
  double normal_noise_share = 0.005;  // of the trace: what normals off by 4 deg pretend to know
  double kappa = 2.0;                 // neighbouring beams are correlated: sigma^2 = kappa / information
  double lost_sigma_m = 0.020;        // what faces the weak axis holds it no better than this: degenerate ...
  int lost_scans = 3;                 // ... after so many in a row ...
  double found_sigma_m = 0.015;       // ... and again not, from leave_scans scans in a row as good as this
  double speed_sigma_m_s = 0.02;      // growth of the axial variance while degenerate
  double accel_sigma_m_s2 = 0.3;
  double min_associated = 40;  // points on surfaces, below which nothing is concluded
};

// Two questions a scan. Do the walls as a whole leave a motion weak, with whatever turn makes it weakest? That is a
// ratio, latched, and tells the matcher to believe only walls that face this axis. Do those few hold it? Ten beams on
// the end of a corridor do, and then nothing is lost; where there are none, the scan is degenerate.
class DegeneracyMonitor {
 public:
  explicit DegeneracyMonitor(const DegeneracyOptions& options) : options_(options) {}

  // Looks at the line system H at the predicted pose (map frame). step_s: time since the last scan.
  void update(const Eigen::Matrix3d& information, int associated, double step_s);
  // What the walls facing axis() know along it [1/m^2]. Call after update() while weak().
  void hold(double axial_information);
  void reset();

  // One direction is weak: axis(), with turn_rad_m() of the cart as it goes.
  [[nodiscard]] bool weak() const { return weak_; }
  // Nothing holds it.
  [[nodiscard]] bool active() const { return active_; }
  // Unit vector of the weak direction, map frame, while weak().
  [[nodiscard]] const Eigen::Vector2d& axis() const { return axis_; }
  [[nodiscard]] double turn_rad_m() const { return turn_rad_m_; }
  // Variance of the position along the axis gathered since it became unobservable [m^2].
  [[nodiscard]] double axial_variance_m2() const;
  // What hold() was told last [1/m^2].
  [[nodiscard]] double axial_information() const { return axial_information_; }
  [[nodiscard]] double time_s() const { return time_s_; }
  void change_frame(double yaw_rad);

 private:
  struct Weakness {
    double ratio = 1.0;
    Eigen::Vector2d axis = Eigen::Vector2d::UnitX();
  };
  // Of the smaller to the larger eigenvalue, and the axis of the smaller.
  [[nodiscard]] Weakness weakness(const Eigen::Matrix2d& block) const;

  DegeneracyOptions options_;
  bool weak_ = false;
  bool active_ = false;
  int good_scans_ = 0;   // in a row with more than leave_ratio
  int held_scans_ = 0;   // in a row in which something held the axis
  int loose_scans_ = 0;  // in a row in which nothing did
  double axial_information_ = 0.0;
  double time_s_ = 0.0;  // degenerate since
  Eigen::Vector2d axis_ = Eigen::Vector2d::UnitX();
  double turn_rad_m_ = 0.0;
};

}  // namespace submapd
