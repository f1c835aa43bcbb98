// What a finished sub-map's values must satisfy before anyone may rely on them (finished_submap.hpp says what they
// mean).
//
// Used when bytes are decoded and before a sub-map is saved, so that what is saved can be loaded. Each function returns
// what is wrong, or an empty view. Lists are checked item by item, each against the one before it (null: the first).
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "slam/base/status.hpp"
#include "slam/submap/finished_submap.hpp"

namespace submapd {

inline constexpr std::size_t kMaxBeams = 10'000;
inline constexpr double kMaxCoordinate_m = 1e6;          // of any pose
inline constexpr std::int32_t kMaxBlockIndex = 1 << 20;  // keeps 64 * index inside 32 bits

[[nodiscard]] bool is_sound(const Pose2& pose);  // finite and within kMaxCoordinate_m
[[nodiscard]] bool is_sound(const ScanGeometry& geometry);

[[nodiscard]] std::string_view head_problem(const FinishedSubmap& submap);
[[nodiscard]] std::string_view problem_of(const Keyframe& keyframe, const Keyframe* previous);
[[nodiscard]] std::string_view problem_of(const OccupancyBlock& block, const OccupancyBlock* previous);
[[nodiscard]] std::string_view problem_of(const SurfacePoint& point, const SurfacePoint* previous);

// All of the above: kInvalidArgument with the first problem.
[[nodiscard]] Status check_submap(const FinishedSubmap& submap);

}  // namespace submapd
