#include "proto/graph_conversion.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <optional>
#include <vector>

#include "proto/lcm_message.hpp"
#include "submapd/graph_t.hpp"

namespace submapd {
namespace {

const Uuid kCart = Uuid::from_seed(1, 1);
const Uuid kRun = Uuid::from_seed(1, 2);

GraphState graph(std::uint32_t version, std::uint32_t submaps, std::uint32_t loops) {
  GraphState state;
  state.version = version;
  for (std::uint32_t i = 0; i < submaps; ++i) state.submaps.push_back({i, {i * 1.5, -2.0, 0.1 * i}});
  for (std::uint32_t i = 0; i < loops; ++i) {
    Loop loop;
    loop.match.a = i;
    loop.match.b = i + 7;
    loop.match.a_from_b = {0.1 * i, 2.0, 3.0};
    loop.match.covariance = Eigen::Matrix3d::Constant(i * 0.5);
    loop.match.score = 0.8;
    loop.match.overlap_m2 = i;
    loop.match.overlap_share = 0.25;
    loop.match.contradiction = 0.01;
    loop.match.second_peak = 0.6;
    loop.match.weak = i % 2 == 0;
    loop.match.verdict = static_cast<MatchVerdict>(i % 8);
    loop.state = static_cast<LoopState>(i % 3);
    state.loops.push_back(loop);
  }
  return state;
}

void expect_same(const GraphState& a, const GraphState& b) {
  EXPECT_EQ(a.version, b.version);
  ASSERT_EQ(a.submaps.size(), b.submaps.size());
  for (std::size_t i = 0; i < a.submaps.size(); ++i) {
    EXPECT_EQ(a.submaps[i].index, b.submaps[i].index);
    EXPECT_EQ(a.submaps[i].map_from_submap, b.submaps[i].map_from_submap);
  }
  ASSERT_EQ(a.loops.size(), b.loops.size());
  for (std::size_t i = 0; i < a.loops.size(); ++i) {
    const SubmapMatch& x = a.loops[i].match;
    const SubmapMatch& y = b.loops[i].match;
    EXPECT_TRUE(x.a == y.a && x.b == y.b && x.a_from_b == y.a_from_b && x.covariance == y.covariance);
    EXPECT_TRUE(x.score == y.score && x.overlap_m2 == y.overlap_m2 && x.overlap_share == y.overlap_share);
    EXPECT_TRUE(x.contradiction == y.contradiction && x.second_peak == y.second_peak && x.weak == y.weak);
    EXPECT_TRUE(x.verdict == y.verdict && a.loops[i].state == b.loops[i].state);
  }
}

TEST(GraphConversion, SmallAndLargeComeBackInAnyOrderOfParts) {
  for (const auto& [submaps, loops] : {std::pair{0U, 0U}, {3U, 2U}, {5000U, 3000U}}) {
    const GraphState state = graph(9, submaps, loops);
    std::vector<std::vector<std::byte>> messages = encode_graph(state, 5, kCart, kRun);
    EXPECT_EQ(messages.size() > 1, submaps == 5000U);
    std::reverse(messages.begin(), messages.end());
    GraphAssembler assembler;
    std::optional<GraphState> whole;
    for (const std::vector<std::byte>& message : messages) {
      EXPECT_LE(message.size(), kMaxMessageBytes);
      EXPECT_FALSE(whole.has_value());
      whole = assembler.add(decode_graph_part(message).value());
    }
    ASSERT_TRUE(whole.has_value());
    expect_same(*whole, state);
    EXPECT_FALSE(assembler.add(decode_graph_part(messages.front()).value()).has_value());  // repeated
  }
}

TEST(GraphConversion, NewerVersionReplacesWhatWasBegunAndOlderIsIgnored) {
  const auto old_parts = encode_graph(graph(1, 5000, 0), 5, kCart, kRun);
  const auto new_parts = encode_graph(graph(2, 10, 0), 6, kCart, kRun);
  GraphAssembler assembler;
  EXPECT_FALSE(assembler.add(decode_graph_part(old_parts[0]).value()).has_value());
  EXPECT_TRUE(assembler.add(decode_graph_part(new_parts[0]).value()).has_value());
  for (const auto& part : old_parts) EXPECT_FALSE(assembler.add(decode_graph_part(part).value()).has_value());
  const auto other_run = encode_graph(graph(1, 1, 0), 7, kCart, Uuid::from_seed(2, 2));
  EXPECT_TRUE(assembler.add(decode_graph_part(other_run[0]).value()).has_value());
}

TEST(GraphConversion, HostilePartsAreRefused) {
  const auto refused = [](auto change) {
    graph_t message{};
    message.parts = 1;
    message.nsubmaps = 1;
    message.submaps.resize(1);
    message.nloops = 1;
    message.loops.resize(1);
    message.loops[0].b = 1;
    EXPECT_TRUE(decode_graph_part(encode_message(message)).has_value());
    change(message);
    return !decode_graph_part(encode_message(message)).has_value();
  };
  EXPECT_TRUE(refused([](graph_t& m) { m.version = -1; }));
  EXPECT_TRUE(refused([](graph_t& m) { m.part = 1; }));
  EXPECT_TRUE(refused([](graph_t& m) { m.part = -1; }));
  EXPECT_TRUE(refused([](graph_t& m) { m.parts = std::numeric_limits<std::int32_t>::max(); }));
  EXPECT_TRUE(refused([](graph_t& m) { m.submaps[0].submap = -1; }));
  EXPECT_TRUE(refused([](graph_t& m) { m.submaps[0].map_from_submap[0] = std::numeric_limits<double>::infinity(); }));
  EXPECT_TRUE(refused([](graph_t& m) { m.loops[0].a = 1; }));
  EXPECT_TRUE(refused([](graph_t& m) { m.loops[0].state = 3; }));
  EXPECT_TRUE(refused([](graph_t& m) { m.loops[0].verdict = -1; }));
  EXPECT_TRUE(refused([](graph_t& m) { m.loops[0].weak = 2; }));
  EXPECT_TRUE(refused([](graph_t& m) { m.loops[0].covariance[4] = std::numeric_limits<double>::quiet_NaN(); }));

  std::vector<std::byte> bytes = encode_graph(graph(1, 2, 2), 5, kCart, kRun).front();
  const std::size_t counts = static_cast<std::size_t>(graph_t{}.getEncodedSize()) - 8;
  for (const std::size_t offset : {counts, counts + 4}) {
    std::vector<std::byte> absurd = bytes;
    absurd[offset] = std::byte{0x7F};
    EXPECT_FALSE(decode_graph_part(absurd).has_value());
    absurd[offset] = std::byte{0xFF};
    EXPECT_FALSE(decode_graph_part(absurd).has_value());
  }
}

}  // namespace
}  // namespace submapd
