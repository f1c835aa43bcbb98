// What a map says about its own quality, without any truth (design notes, section 15): report.json's figures.
//
// None alone proves a map right: thick walls and residuals show blur and strain, but a smooth warp shows in none of
// them. Value type and its collector; one thread.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "slam/graph/optimizer.hpp"
#include "slam/output/map_image.hpp"
#include "slam/output/pose_spool.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd {

// How far a confirmed loop's match is from what the optimised sub-maps say. Those that are in the graph pull it: the
// figure shows strain, not error.
struct LoopResidual {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  double distance_m = 0.0;
  double turn_rad = 0.0;
  double sigmas = 0.0;         // by the match's own covariance; about 1.5 if that is right (three degrees of freedom)
  double contradiction = 0.0;  // share of occupied cells the other sub-map saw as free
};

struct RunQuality {
  // Spread of the hits across each piece of wall, within sub-maps: noise of the ranges and of the poses together.
  std::uint64_t wall_pieces = 0;
  double wall_sigma_p50_m = 0.0;
  double wall_sigma_p95_m = 0.0;
  // The delivered map.
  double free_m2 = 0.0;
  double occupied_m2 = 0.0;
  double undecided_share = 0.0;  // of the cells that were seen: occupied with 0.2 < p < 0.8
  // Consistency.
  std::vector<LoopResidual> loops;  // confirmed ones
  double bend_m = 0.0;              // farthest that the optimisation moved a key-frame from where the filter had it
  // What the filter itself doubted.
  std::uint64_t keyframes = 0;
  std::uint64_t keyframes_degenerate = 0;  // a direction was not observable
  std::uint64_t breaks = 0;                // places where only loops tie the map together
};

class QualityCollector {
 public:
  // Each sub-map once, in any order.
  void note_submap(const FinishedSubmap& submap);
  // Each scan in order of time.
  void note_pose(const SpooledPose& spooled, const Pose2& map_from_base);
  [[nodiscard]] RunQuality result(const MapImage& map, const FinalResult& final_result) const;

 private:
  static constexpr double kBin_m = 0.0005;
  [[nodiscard]] double sigma_at(double share) const;

  RunQuality quality_;
  std::array<std::uint64_t, 200> sigmas_{};  // up to 10 cm, the last holds what is beyond
  std::optional<Pose2> filter_;              // the newest key-frame by the filter's steps alone
};

}  // namespace submapd
