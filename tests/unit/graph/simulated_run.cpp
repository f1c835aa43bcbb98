#include "tests/unit/graph/simulated_run.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "slam/base/random.hpp"
#include "slam/graph/internal/loop_candidates.hpp"
#include "slam/graph/internal/uncertain_pose.hpp"

namespace submapd::testing {
namespace {

constexpr double kStepM = 0.3;
constexpr std::size_t kKeyframesApart = 33;  // 10 m between the origins of neighbours
constexpr double kReachM = 8.0;              // how far a sub-map sees about its centre
constexpr double kMatchSigmaM = 0.02;
constexpr double kMatchSigmaRad = 0.1 * graph::kDegree;
constexpr double kLandmarkSigmaM = 0.01;

enum Stream : std::uint64_t { kSteps = 1000, kMatches, kSpots, kLies };

double lens_area_m2(double r, double s, double distance) {
  if (distance >= r + s) return 0.0;
  const double small = std::min(r, s);
  if (distance <= std::abs(r - s)) return std::numbers::pi * small * small;
  const double p = std::acos((distance * distance + r * r - s * s) / (2.0 * distance * r));
  const double q = std::acos((distance * distance + s * s - r * r) / (2.0 * distance * s));
  return r * r * (p - std::sin(2.0 * p) / 2.0) + s * s * (q - std::sin(2.0 * q) / 2.0);
}

std::uint64_t pair_key(std::uint32_t a, std::uint32_t b) {
  return std::uint64_t{a} << 32 | b;
}

Eigen::Vector2d centre_of(const FinishedSubmap& submap) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const Keyframe& keyframe : submap.keyframes) sum += keyframe.pose.translation();
  return sum / static_cast<double>(submap.keyframes.size());
}

SubmapOutline outline_of(const FinishedSubmap& submap) {
  SubmapOutline outline;
  outline.index = submap.id.index;
  outline.centre = centre_of(submap);
  outline.radius_m = kReachM;
  const double cell = outline.coarse_cell_m;
  const int reach = static_cast<int>(kReachM / cell) + 1;
  const Eigen::Vector2i middle = (outline.centre / cell).array().floor().cast<int>();
  for (int y = middle.y() - reach; y <= middle.y() + reach; ++y) {
    for (int x = middle.x() - reach; x <= middle.x() + reach; ++x) {
      if ((cell * Eigen::Vector2d(x + 0.5, y + 0.5) - outline.centre).norm() > kReachM) continue;
      outline.known.push_back({static_cast<std::int16_t>(x), static_cast<std::int16_t>(y)});
    }
  }
  return outline;
}

double outline_overlap_m2(const SubmapOutline& a, const SubmapOutline& b, const Pose2& a_from_b, double grow_m) {
  return lens_area_m2(a.radius_m + grow_m, b.radius_m, (transform(a_from_b, b.centre) - a.centre).norm());
}

}  // namespace

std::vector<Pose2> ring_path(double circumference_m, double laps) {
  std::vector<Pose2> path;
  const double radius = circumference_m / (2.0 * std::numbers::pi);
  const auto steps = static_cast<std::size_t>(circumference_m * laps / kStepM);
  for (std::size_t k = 0; k <= steps; ++k) {
    const double angle = static_cast<double>(k) * kStepM / radius;
    path.push_back({radius * std::sin(angle), radius * (1.0 - std::cos(angle)), angle});
  }
  return path;
}

std::vector<Pose2> corridor_path(double length_m) {
  std::vector<Pose2> path;
  const auto steps = static_cast<std::size_t>(length_m / kStepM);
  for (std::size_t k = 0; k <= steps; ++k) path.push_back({static_cast<double>(k) * kStepM, 0.0, 0.0});
  for (int turn = 1; turn < 12; ++turn) {
    const double angle = turn * std::numbers::pi / 12.0;
    path.push_back({length_m + std::sin(angle), 1.0 - std::cos(angle), angle});
  }
  for (std::size_t k = 0; k <= steps; ++k) {
    path.push_back({length_m - static_cast<double>(k) * kStepM, 2.0, std::numbers::pi});
  }
  return path;
}

SimulatedRun::SimulatedRun(const std::vector<Pose2>& path, const SimulatedRunOptions& options)
    : options_(options), truth_(path) {
  odom_.push_back(truth_.front());
  CounterRandom random(options.seed, kSteps, 0);
  for (std::size_t k = 1; k < truth_.size(); ++k) {
    Pose2 step = between(truth_[k - 1], truth_[k]);
    step.x += options.step_sigma_m * random.gaussian();
    step.y += options.step_sigma_m * random.gaussian();
    step.yaw += options.step_sigma_rad * random.gaussian();
    odom_.push_back(compose(odom_.back(), step));
  }
  for (std::size_t first = 0; first + kKeyframesApart / 2 < truth_.size(); first += kKeyframesApart) {
    auto submap = std::make_shared<FinishedSubmap>();
    const auto index = static_cast<std::uint32_t>(submaps_.size());
    submap->id.index = index;
    submap->linked_to_previous = std::find(options.breaks.begin(), options.breaks.end(), index) == options.breaks.end();
    const bool next_breaks = std::find(options.breaks.begin(), options.breaks.end(), index + 1) != options.breaks.end();
    // After a break there is nothing in common.
    const std::size_t end = std::min(truth_.size(), first + (next_breaks ? 1 : 2) * kKeyframesApart);
    submap->odom_from_submap = odom_[first];
    for (std::size_t k = first; k < end; ++k) {
      Keyframe keyframe;
      keyframe.scan_index = k;
      keyframe.stamp_us = static_cast<std::int64_t>(k) * 100'000;
      keyframe.pose = k == first ? Pose2{} : between(odom_[first], odom_[k]);
      keyframe.step_covariance =
          graph::pose_covariance(std::max(1e-6, options.step_sigma_m), std::max(1e-7, options.step_sigma_rad));
      submap->keyframes.push_back(keyframe);
    }
    first_.push_back(first);
    submaps_.push_back(std::move(submap));
  }
}

Expected<std::shared_ptr<const FinishedSubmap>> SimulatedRun::load(std::uint32_t index) {
  if (index >= submaps_.size()) return failure(StatusCode::kNotFound, "no such sub-map");
  return submaps_[index];
}

PairTools SimulatedRun::tools() const {
  PairTools tools;
  tools.make_outline = outline_of;
  tools.overlap_m2 = outline_overlap_m2;
  tools.search = [this](const SubmapView& a, const SubmapView& b, const MatchPrior& prior) {
    return search(a.submap, b.submap, prior);
  };
  tools.refine = [this](const SubmapView& a, const SubmapView& b, const Pose2&) { return refine(a.submap, b.submap); };
  tools.choose_landmarks = [this](const SubmapView& a, const SubmapView& b, const SubmapMatch& match) {
    return landmarks(a.submap, b.submap, match);
  };
  return tools;
}

std::size_t SimulatedRun::nearest_keyframe(const FinishedSubmap& submap, const Eigen::Vector2d& place) const {
  std::size_t best = 0;
  for (std::size_t k = 1; k < submap.keyframes.size(); ++k) {
    const auto distance = [&](std::size_t i) {
      return (truth_[submap.keyframes[i].scan_index].translation() - place).norm();
    };
    if (distance(k) < distance(best)) best = k;
  }
  return best;
}

Eigen::Vector2d SimulatedRun::middle(std::uint32_t a, std::uint32_t b) const {
  const auto centre = [&](std::uint32_t index) {
    const auto& keyframes = submaps_[index]->keyframes;
    return truth_[keyframes[keyframes.size() / 2].scan_index].translation();
  };
  return 0.5 * (centre(a) + centre(b));
}

// Where the maps fit at the middle of the overlap: both are bent a little by their drift.
Pose2 SimulatedRun::true_relative(const FinishedSubmap& a, const FinishedSubmap& b) const {
  const Eigen::Vector2d place = middle(a.id.index, b.id.index);
  const Keyframe& in_a = a.keyframes[nearest_keyframe(a, place)];
  const Keyframe& in_b = b.keyframes[nearest_keyframe(b, place)];
  const Pose2 relative = between(truth_[in_a.scan_index], truth_[in_b.scan_index]);
  return compose(compose(in_a.pose, relative), inverse(in_b.pose));
}

double SimulatedRun::true_overlap_m2(const FinishedSubmap& a, const FinishedSubmap& b) const {
  return outline_overlap_m2(outline_of(a), outline_of(b), true_relative(a, b), 0.0);
}

bool SimulatedRun::is_true(const SubmapMatch& match) const {
  const Pose2 off = between(true_relative(*submaps_[match.a], *submaps_[match.b]), match.a_from_b);
  return off.translation().norm() < 0.2 && std::abs(off.yaw) < 1.0 * graph::kDegree;
}

SubmapMatch SimulatedRun::refine(const FinishedSubmap& a, const FinishedSubmap& b) const {
  CounterRandom random(options_.seed, kMatches, pair_key(a.id.index, b.id.index));
  SubmapMatch match;
  match.a = a.id.index;
  match.b = b.id.index;
  match.a_from_b = true_relative(a, b);
  match.a_from_b.x += options_.match_noise * kMatchSigmaM * random.gaussian();
  match.a_from_b.y += options_.match_noise * kMatchSigmaM * random.gaussian();
  match.a_from_b.yaw += options_.match_noise * kMatchSigmaRad * random.gaussian();
  match.covariance = graph::pose_covariance(kMatchSigmaM, kMatchSigmaRad);
  match.score = 0.85;
  match.contradiction = 0.01;
  match.overlap_m2 = true_overlap_m2(a, b);
  match.verdict = MatchVerdict::kAccepted;
  return match;
}

SubmapMatch SimulatedRun::search(const FinishedSubmap& a, const FinishedSubmap& b, const MatchPrior& prior) const {
  CounterRandom random(options_.seed, kLies, pair_key(a.id.index, b.id.index));
  SubmapMatch match = refine(a, b);
  const double lot = random.uniform();
  if (lot < options_.false_loops) {
    const Eigen::Vector3d window = graph::search_window(prior.covariance);
    do {
      match.a_from_b = {prior.a_from_b.x + random.uniform(-window.x(), window.x()),
                        prior.a_from_b.y + random.uniform(-window.y(), window.y()),
                        prior.a_from_b.yaw + random.uniform(-window.z(), window.z())};
    } while (is_true(match));
    return match;  // as if it had passed the gate too: what is left is for the policy to see through
  } else if (lot < options_.false_loops + options_.failures ||
             match.overlap_m2 < SubmapMatcherOptions{}.min_overlap_m2) {
    match.verdict = MatchVerdict::kNoPeak;
    return match;
  }
  const Pose2 off{match.a_from_b.x - prior.a_from_b.x, match.a_from_b.y - prior.a_from_b.y,
                  match.a_from_b.yaw - prior.a_from_b.yaw};
  if (graph::mahalanobis2(off, prior.covariance + match.covariance) > SubmapMatcherOptions{}.gate_chi2) {
    match.verdict = MatchVerdict::kGate;
  }
  return match;
}

std::vector<VirtualLandmark> SimulatedRun::landmarks(const FinishedSubmap& a, const FinishedSubmap& b,
                                                     const SubmapMatch& match) const {
  CounterRandom random(options_.seed, kSpots, pair_key(a.id.index, b.id.index));
  const Eigen::Vector2d place = middle(a.id.index, b.id.index);
  const double sigma = options_.match_noise * kLandmarkSigmaM;
  const bool lie = !is_true(match);
  std::vector<VirtualLandmark> chosen;
  for (int k = 0; k < 8; ++k) {
    // One by one: in what order the arguments of a call are drawn depends on the compiler.
    const double aside = random.uniform(-5.0, 5.0);
    const double ahead = random.uniform(-5.0, 5.0);
    const Eigen::Vector2d spot = place + Eigen::Vector2d(ahead, aside);
    const auto seen_in = [&](const FinishedSubmap& submap) -> Eigen::Vector2d {
      const Keyframe& keyframe = submap.keyframes[nearest_keyframe(submap, spot)];
      const double noise_y = random.gaussian();
      const double noise_x = random.gaussian();
      return transform(keyframe.pose, transform(inverse(truth_[keyframe.scan_index]), spot)) +
             sigma * Eigen::Vector2d(noise_x, noise_y);
    };
    VirtualLandmark landmark;
    landmark.a = a.id.index;
    landmark.b = b.id.index;
    landmark.in_a = seen_in(a);
    landmark.in_b = seen_in(b);
    if (lie) landmark.in_b = transform(inverse(match.a_from_b), landmark.in_a);
    landmark.covariance_a = kLandmarkSigmaM * kLandmarkSigmaM * Eigen::Matrix2d::Identity();
    landmark.covariance_b = landmark.covariance_a;
    for (const FinishedSubmap* submap : {&a, &b}) {
      auto& seen_from = submap == &a ? landmark.seen_from_a : landmark.seen_from_b;
      const std::size_t nearest = nearest_keyframe(*submap, spot);
      for (int n = -1; n <= 1; ++n) {  // three key-frames about the nearest, as far as there are
        const auto last = static_cast<int>(submap->keyframes.size()) - 1;
        const int index = std::clamp(static_cast<int>(nearest) + 12 * n, 0, last);
        seen_from.push_back(static_cast<std::uint32_t>(index));
      }
    }
    chosen.push_back(landmark);
  }
  return chosen;
}

double rmse_m(const SimulatedRun& run, const std::vector<SubmapPose>& submaps) {
  double sum = 0.0;
  for (const SubmapPose& submap : submaps) {
    sum += (submap.map_from_submap.translation() - run.truth_of_submap(submap.index).translation()).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(submaps.size()));
}

double rmse_m(const SimulatedRun& run, const std::vector<OptimizedKeyframe>& keyframes) {
  double sum = 0.0;
  for (const OptimizedKeyframe& keyframe : keyframes) {
    sum += (keyframe.map_from_base.translation() - run.truth()[keyframe.scan_index].translation()).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(keyframes.size()));
}

double revisit_rmse_m(const SimulatedRun& run, const std::vector<OptimizedKeyframe>& keyframes) {
  constexpr std::size_t kStride = 8;
  double sum = 0.0;
  int count = 0;
  for (std::size_t i = 0; i < keyframes.size(); i += kStride) {
    for (std::size_t j = i + 100; j < keyframes.size(); j += kStride) {
      const Pose2 truth = between(run.truth()[keyframes[i].scan_index], run.truth()[keyframes[j].scan_index]);
      if (truth.translation().norm() > 4.0) continue;
      const Pose2 found = between(keyframes[i].map_from_base, keyframes[j].map_from_base);
      sum += (found.translation() - truth.translation()).squaredNorm();
      ++count;
    }
  }
  return std::sqrt(sum / std::max(1, count));
}

}  // namespace submapd::testing
