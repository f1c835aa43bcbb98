#include "slam/graph/internal/graph_model.hpp"

#include <utility>

#include "slam/base/small_matrix.hpp"

namespace submapd::graph {
namespace {

// What a sub-map bends inside although it is used as rigid: the rule that cuts sub-maps allows 2 cm (notes 7).
const Eigen::Matrix3d kModelError = pose_covariance(0.02, 0.1 * kDegree);

constexpr double kEdgeFloorM = 0.01;
constexpr double kEdgeFloorRad = 0.2 * kDegree;

// Indices of the key-frames both hold, ascending.
std::vector<std::pair<std::size_t, std::size_t>> shared_keyframes(const SubmapRecord& a, const SubmapRecord& b) {
  std::vector<std::pair<std::size_t, std::size_t>> shared;
  std::size_t i = 0;
  std::size_t j = 0;
  while (i < a.keyframes.size() && j < b.keyframes.size()) {
    const std::uint64_t in_a = a.keyframes[i].scan_index;
    const std::uint64_t in_b = b.keyframes[j].scan_index;
    if (in_a == in_b) shared.emplace_back(i, j);
    if (in_a <= in_b) ++i;
    if (in_b <= in_a) ++j;
  }
  return shared;
}

// Covariance of key-frame `last` in the sub-map's frame from the steps up to it.
Eigen::Matrix3d compounded_steps(const SubmapRecord& submap, std::size_t last) {
  UncertainPose reached;
  for (std::size_t k = 1; k <= last; ++k) {
    const TrackPoint& point = submap.keyframes[k];
    reached = compose(reached, UncertainPose{between(submap.keyframes[k - 1].pose, point.pose), point.step()});
  }
  return reached.covariance;
}

}  // namespace

Eigen::Matrix3d TrackPoint::step() const {
  Eigen::Matrix3d covariance;
  const auto& s = step_covariance;
  covariance << s[0], s[1], s[2], s[1], s[3], s[4], s[2], s[4], s[5];
  return covariance;
}

UncertainPose GraphModel::measured(const LoopRecord& loop) const {
  const SubmapMatch& match = loop.loop.match;
  return {match.a_from_b, match.covariance + kModelError};
}

void GraphModel::place_condensed() {
  for (std::size_t k = 0; k < submaps.size(); ++k) {
    if (submaps[k].condensed()) poses[k] = compose(poses[submaps[k].hub], links[k].edge.mean);
  }
}

SubmapRecord make_record(const FinishedSubmap& submap, SubmapOutline outline) {
  SubmapRecord record;
  record.odom_from_submap = submap.odom_from_submap;
  outline.known.shrink_to_fit();
  record.outline = std::make_shared<const SubmapOutline>(std::move(outline));
  record.keyframes.reserve(submap.keyframes.size());
  for (const Keyframe& keyframe : submap.keyframes) {
    TrackPoint point{keyframe.scan_index, keyframe.stamp_us, keyframe.pose, {}};
    std::size_t k = 0;
    for (int row = 0; row < 3; ++row) {
      for (int column = row; column < 3; ++column) {
        point.step_covariance[k++] = static_cast<float>(keyframe.step_covariance(row, column));
      }
    }
    record.keyframes.push_back(point);
  }
  return record;
}

bool share_keyframes(const SubmapRecord& a, const SubmapRecord& b) {
  return a.keyframes.front().scan_index <= b.keyframes.back().scan_index &&
         b.keyframes.front().scan_index <= a.keyframes.back().scan_index;
}

ChainLink make_link(const SubmapRecord& a, const SubmapRecord& b, bool linked) {
  ChainLink link;
  const auto shared = shared_keyframes(a, b);
  if (!linked || shared.empty()) {
    link.edge = {between(a.odom_from_submap, b.odom_from_submap), pose_covariance(kBreakM, kBreakRad)};
    return link;
  }
  link.linked = true;
  const auto value = [&](const std::pair<std::size_t, std::size_t>& pair) {
    return compose(a.keyframes[pair.first].pose, inverse(b.keyframes[pair.second].pose));
  };
  const double count = static_cast<double>(shared.size());
  Pose2 mean = value(shared.front());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();  // in the frame of `mean`
  for (int pass = 0; pass < 3; ++pass) {             // two for the mean, the last for the spread about it
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    spread.setZero();
    for (const auto& pair : shared) {
      const Pose2 off = between(mean, value(pair));
      const Eigen::Vector3d d(off.x, off.y, off.yaw);
      sum += d;
      spread += d * d.transpose();
    }
    if (pass < 2) mean = compose(mean, {sum.x() / count, sum.y() / count, sum.z() / count});
  }
  // Spread of the mean, times 4 because neighbouring key-frames err together. When both sub-maps took their poses from
  // one track it is zero and says nothing: what is uncertain then is where b's origin lies in a, which the steps tell.
  link.edge.mean = {mean.x, mean.y, wrap_angle(mean.yaw)};
  link.edge.covariance = turned(spread * (4.0 / (count * count)), mean.yaw) +
                         pose_covariance(kEdgeFloorM, kEdgeFloorRad) + compounded_steps(a, shared.front().first);
  return link;
}

std::size_t bytes_of(const SubmapRecord& record) {
  return sizeof(SubmapRecord) + sizeof(Pose2) + sizeof(ChainLink) + record.keyframes.capacity() * sizeof(TrackPoint) +
         (record.outline == nullptr
              ? 0
              : sizeof(SubmapOutline) + record.outline->known.capacity() * sizeof(record.outline->known[0]));
}

std::size_t bytes_of(const std::vector<VirtualLandmark>& landmarks) {
  constexpr std::size_t kHeapBlock = 16;  // what an allocation costs besides its bytes
  std::size_t bytes = landmarks.capacity() * sizeof(VirtualLandmark);
  for (const VirtualLandmark& landmark : landmarks) {
    bytes +=
        2 * kHeapBlock + (landmark.seen_from_a.capacity() + landmark.seen_from_b.capacity()) * sizeof(std::uint32_t);
  }
  return bytes;
}

}  // namespace submapd::graph
