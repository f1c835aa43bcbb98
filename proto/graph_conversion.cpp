#include "proto/graph_conversion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <utility>

#include "proto/lcm_message.hpp"
#include "slam/submap/submap_check.hpp"
#include "submapd/graph_t.hpp"

namespace submapd {
namespace {

// Encoded sizes of the items; the nested types carry no hash of their own.
const std::size_t kSubmapPoseBytes = static_cast<std::size_t>(submap_pose_t{}._getEncodedSizeNoHash());
const std::size_t kLoopBytes = static_cast<std::size_t>(loop_t{}._getEncodedSizeNoHash());

submap_pose_t to_message(const SubmapPose& pose) {
  submap_pose_t message{};
  message.submap = static_cast<std::int32_t>(pose.index);
  put_pose(pose.map_from_submap, message.map_from_submap);
  return message;
}

loop_t to_message(const Loop& loop) {
  loop_t message{};
  message.a = static_cast<std::int32_t>(loop.match.a);
  message.b = static_cast<std::int32_t>(loop.match.b);
  put_pose(loop.match.a_from_b, message.a_from_b);
  for (int i = 0; i < 9; ++i) message.covariance[i] = loop.match.covariance(i / 3, i % 3);
  message.score = loop.match.score;
  message.overlap_m2 = loop.match.overlap_m2;
  message.overlap_share = loop.match.overlap_share;
  message.contradiction = loop.match.contradiction;
  message.second_peak = loop.match.second_peak;
  message.weak = loop.match.weak ? 1 : 0;
  message.verdict = static_cast<std::int8_t>(loop.match.verdict);
  message.state = static_cast<std::int8_t>(loop.state);
  return message;
}

SubmapPose to_value(const submap_pose_t& message) {
  return {static_cast<std::uint32_t>(message.submap), get_pose(message.map_from_submap)};
}

Loop to_value(const loop_t& message) {
  Loop loop;
  loop.match.a = static_cast<std::uint32_t>(message.a);
  loop.match.b = static_cast<std::uint32_t>(message.b);
  loop.match.a_from_b = get_pose(message.a_from_b);
  for (int i = 0; i < 9; ++i) loop.match.covariance(i / 3, i % 3) = message.covariance[i];
  loop.match.score = message.score;
  loop.match.overlap_m2 = message.overlap_m2;
  loop.match.overlap_share = message.overlap_share;
  loop.match.contradiction = message.contradiction;
  loop.match.second_peak = message.second_peak;
  loop.match.weak = message.weak == 1;
  loop.match.verdict = static_cast<MatchVerdict>(message.verdict);
  loop.state = static_cast<LoopState>(message.state);
  return loop;
}

bool is_sound(const submap_pose_t& message) {
  return message.submap >= 0 && is_sound(get_pose(message.map_from_submap));
}

bool is_sound(const loop_t& message) {
  const bool finite = std::all_of(std::begin(message.covariance), std::end(message.covariance),
                                  [](double value) { return std::isfinite(value); }) &&
                      std::isfinite(message.score) && std::isfinite(message.overlap_m2) &&
                      std::isfinite(message.overlap_share) && std::isfinite(message.contradiction) &&
                      std::isfinite(message.second_peak);
  return finite && message.a >= 0 && message.a < message.b && is_sound(get_pose(message.a_from_b)) &&
         (message.weak == 0 || message.weak == 1) && message.verdict >= 0 &&
         message.verdict <= static_cast<std::int8_t>(MatchVerdict::kGate) && message.state >= 0 &&
         message.state <= static_cast<std::int8_t>(LoopState::kRejected);
}

std::string_view problem_of(const graph_t& message) {
  if (message.version < 0) return "negative version";
  if (message.part < 0 || message.part >= message.parts) return "part out of range";
  if (message.parts > static_cast<std::int32_t>(kMaxGraphParts)) return "too many parts";
  for (const submap_pose_t& pose : message.submaps) {
    if (!is_sound(pose)) return "sub-map pose out of range";
  }
  for (const loop_t& loop : message.loops) {
    if (!is_sound(loop)) return "loop out of range";
  }
  return {};
}

}  // namespace

std::vector<std::vector<std::byte>> encode_graph(const GraphState& state, std::int64_t utime, const Uuid& cart,
                                                 const Uuid& run) {
  graph_t empty{};
  empty.utime = utime;
  put_uuid(cart, empty.cart);
  put_uuid(run, empty.run);
  empty.version = static_cast<std::int32_t>(state.version);

  std::vector<graph_t> messages{empty};
  std::size_t bytes = 0;
  const auto message_for = [&](std::size_t item_bytes) -> graph_t& {
    if (static_cast<std::size_t>(empty.getEncodedSize()) + bytes + item_bytes > kMaxMessageBytes) {
      messages.push_back(empty);
      bytes = 0;
    }
    bytes += item_bytes;
    return messages.back();
  };
  for (const SubmapPose& pose : state.submaps) message_for(kSubmapPoseBytes).submaps.push_back(to_message(pose));
  for (const Loop& loop : state.loops) message_for(kLoopBytes).loops.push_back(to_message(loop));

  std::vector<std::vector<std::byte>> encoded;
  for (graph_t& message : messages) {
    message.part = static_cast<std::int32_t>(encoded.size());
    message.parts = static_cast<std::int32_t>(messages.size());
    message.nsubmaps = static_cast<std::int32_t>(message.submaps.size());
    message.nloops = static_cast<std::int32_t>(message.loops.size());
    encoded.push_back(encode_message(message));
  }
  return encoded;
}

Expected<GraphPart> decode_graph_part(std::span<const std::byte> bytes) {
  const Expected<graph_t> message =
      decode_message<graph_t>(bytes, std::array<std::size_t, 2>{kSubmapPoseBytes, kLoopBytes});
  if (!message) return failure(message.error());
  if (const std::string_view problem = problem_of(*message); !problem.empty()) {
    return failure(StatusCode::kCorrupt, fmt::format("graph_t: {}", problem));
  }
  GraphPart part;
  part.utime = message->utime;
  part.cart = get_uuid(message->cart);
  part.run = get_uuid(message->run);
  part.part = static_cast<std::uint32_t>(message->part);
  part.parts = static_cast<std::uint32_t>(message->parts);
  part.state.version = static_cast<std::uint32_t>(message->version);
  for (const submap_pose_t& pose : message->submaps) part.state.submaps.push_back(to_value(pose));
  for (const loop_t& loop : message->loops) part.state.loops.push_back(to_value(loop));
  return part;
}

std::optional<GraphState> GraphAssembler::add(GraphPart part) {
  const bool same_run = part.run == run_ && !parts_.empty();
  if (same_run && part.state.version < version_) return std::nullopt;
  if (!same_run || part.state.version > version_ || part.parts != parts_.size()) {
    parts_.assign(part.parts, std::nullopt);
    missing_ = part.parts;
    run_ = part.run;
    version_ = part.state.version;
  }
  const std::size_t place = part.part;
  if (parts_[place].has_value()) return std::nullopt;
  parts_[place] = std::move(part);
  if (--missing_ > 0) return std::nullopt;
  GraphState state;
  state.version = version_;
  for (std::optional<GraphPart>& piece : parts_) {
    state.submaps.insert(state.submaps.end(), piece->state.submaps.begin(), piece->state.submaps.end());
    state.loops.insert(state.loops.end(), piece->state.loops.begin(), piece->state.loops.end());
    piece->state = {};  // the place stays taken: a repeated part completes nothing
  }
  return state;
}

}  // namespace submapd
