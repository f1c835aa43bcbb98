#include "tools/replay/replay_report.hpp"

#include <nlohmann/json.hpp>
#include <span>
#include <string>

#include "daemon/map_report.hpp"
#include "slam/base/atomic_file.hpp"

namespace submapd::tools {
namespace {

nlohmann::json json_of(const Pose2& pose) {
  return {pose.x, pose.y, pose.yaw};
}

nlohmann::json json_of(const Eigen::Matrix3d& m) {
  return {m(0, 0), m(0, 1), m(0, 2), m(1, 1), m(1, 2), m(2, 2)};
}

}  // namespace

Status write_replay_report(const std::filesystem::path& path, const RunQuality& quality, const FinalResult& result) {
  nlohmann::json report = quality_report(quality, result);
  nlohmann::json& submaps = report["submaps"] = nlohmann::json::array();
  for (const SubmapPose& submap : result.submaps) {
    nlohmann::json one = {{"index", submap.index}, {"pose", json_of(submap.map_from_submap)}};
    if (submap.index < result.bounds.size()) {
      const SubmapBound& bound = result.bounds[submap.index];
      one["begun_us"] = bound.begun_us;
      one["covariance_bound"] = json_of(bound.covariance);
    }
    submaps.push_back(std::move(one));
  }
  nlohmann::json& matches = report["matches"] = nlohmann::json::array();
  for (const Loop& loop : result.loops) {
    if (loop.state != LoopState::kConfirmed) continue;
    const SubmapMatch& match = loop.match;
    matches.push_back({{"a", match.a},
                       {"b", match.b},
                       {"a_from_b", json_of(match.a_from_b)},
                       {"covariance", json_of(match.covariance)},
                       {"overlap_m2", match.overlap_m2}});
  }
  nlohmann::json& links = report["links"] = nlohmann::json::array();
  for (const TieStress& tie : result.ties) {
    if (!tie.link) continue;
    links.push_back(
        {{"a", tie.a}, {"b", tie.b}, {"a_from_b", json_of(tie.a_from_b)}, {"covariance", json_of(tie.covariance)}});
  }
  if (!result.keyframes.empty()) {
    const OptimizedKeyframe& last = result.keyframes.back();
    report["end"] = {{"stamp_us", last.stamp_us},
                     {"pose", json_of(last.map_from_base)},
                     {"covariance_bound", json_of(covariance_bound(result, last.stamp_us, last.map_from_base))}};
  }
  const std::string text = report.dump() + "\n";
  return atomic_write_file(path, std::as_bytes(std::span(text)));
}

}  // namespace submapd::tools
