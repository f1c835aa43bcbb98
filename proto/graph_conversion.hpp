// A GraphState as graph_t messages of one datagram each, and back: CART_GRAPH.
//
// No threads: each object belongs to one caller at a time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "slam/base/ids.hpp"
#include "slam/base/status.hpp"
#include "slam/graph/optimizer.hpp"

namespace submapd {

// One message's share of a state.
struct GraphPart {
  std::int64_t utime = 0;
  Uuid cart;
  Uuid run;
  std::uint32_t part = 0;
  std::uint32_t parts = 1;
  GraphState state;  // the whole state's version; this part's sub-maps and loops
};

inline constexpr std::uint32_t kMaxGraphParts = 512;

// The messages of one state, at least one. REQUIRES: fewer sub-maps and loops than kMaxGraphParts datagrams hold (about
// 200 000 loops).
[[nodiscard]] std::vector<std::vector<std::byte>> encode_graph(const GraphState& state, std::int64_t utime,
                                                               const Uuid& cart, const Uuid& run);

// Errors: kCorrupt.
[[nodiscard]] Expected<GraphPart> decode_graph_part(std::span<const std::byte> bytes);

// Collects the parts of the newest state of one run. Holds at most kMaxGraphParts parts.
class GraphAssembler {
 public:
  // The state this part completes, if it does. A newer version, or another run, replaces what was begun.
  [[nodiscard]] std::optional<GraphState> add(GraphPart part);

 private:
  std::vector<std::optional<GraphPart>> parts_;
  std::size_t missing_ = 0;
  Uuid run_;
  std::uint32_t version_ = 0;
};

}  // namespace submapd
