// submapctl landmarks: manual optimisation, the paper's second strategy (2.1.3; design notes, section 12).
//
// What the program cannot decide a person does: ties two sub-maps by spots found in both, takes a tie away, forbids
// one. Each edit is a record of the run's journal; maps are solved anew from journal and archive.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "daemon/configuration.hpp"
#include "tools/landmarks/edited_run.hpp"

namespace submapd::tools {

struct LandmarksOptions {
  std::filesystem::path run;
  Configuration configuration;
  bool loops = true;
  EditedRun::Progress progress = [](std::uint32_t, std::uint32_t) {};
};

// Where somebody sees the same spot in two sub-maps.
struct SpotPair {
  Eigen::Vector2d seen_in_a = Eigen::Vector2d::Zero();
  Eigen::Vector2d seen_in_b = Eigen::Vector2d::Zero();
};

struct AddOptions {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  std::vector<SpotPair> spots;
  bool in_map = true;  // coordinates of the map as it is solved now; false: of the sub-maps' own frames
  bool snap = true;    // let the matcher refine what the points say
  bool force = false;  // commit even if ties break
};

struct LandmarksAnswer {
  std::string text;  // for people
  bool done = true;  // false: refused, nothing was changed, and the text says why
};

// Each solves anew what it needs. Errors: those of EditedRun, kInvalidArgument (no such sub-maps or points).
[[nodiscard]] Expected<LandmarksAnswer> list_suspects(const LandmarksOptions& options);
[[nodiscard]] Expected<LandmarksAnswer> add_tie(const LandmarksOptions& options, const AddOptions& add);
[[nodiscard]] Expected<LandmarksAnswer> remove_tie(const LandmarksOptions& options, std::uint32_t a, std::uint32_t b);
[[nodiscard]] Expected<LandmarksAnswer> forbid_tie(const LandmarksOptions& options, std::uint32_t a, std::uint32_t b);
[[nodiscard]] Expected<LandmarksAnswer> undo_edit(const LandmarksOptions& options);
// Writes trajectory, map, pictures, graph and report.json into `out`, which is made if it is missing.
[[nodiscard]] Expected<LandmarksAnswer> solve_run(const LandmarksOptions& options, const std::filesystem::path& out);

}  // namespace submapd::tools
