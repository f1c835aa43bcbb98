// Whose key-frames a particle's map is made of (DP-SLAM's ancestry tree, design notes 4.5).
//
// A node is one key-frame as one lineage placed it; particles point at leaves. What all particles share moves to the
// root and from there into the base map; lineages without particles die. Pool of fixed size, no allocation after
// construction.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "slam/base/pose2.hpp"

namespace submapd {

class AncestryTree {
 public:
  struct Node {
    Pose2 pose;  // of the key-frame in the sub-map's frame, as this lineage has it
    int parent = -1;
    int children = 0;
    int heads = 0;       // particles whose newest key-frame this is
    int scan_slot = -1;  // whose scan it is
  };

  explicit AncestryTree(int max_nodes);

  // One root without scan, `heads` particles on it.
  void reset(const Pose2& root_pose, int heads);

  // A new key-frame under `parent`; the particle that made it moves its head there. -1 when the pool is full.
  int extend(int parent, const Pose2& pose, int scan_slot);
  void add_head(int node) { ++nodes_[static_cast<std::size_t>(node)].heads; }
  // A particle leaves its node; lineages nobody needs are freed. Slots of freed nodes are appended to freed_slots().
  void remove_head(int node);

  // If all particles descend from one child of the root, makes it the root and returns it: it can go into the base map.
  std::optional<int> advance_root();

  // The root's scan is in the base map: its slot is appended to freed_slots().
  void drop_root_scan();

  [[nodiscard]] const Node& node(int id) const { return nodes_[static_cast<std::size_t>(id)]; }
  [[nodiscard]] int root() const { return root_; }
  [[nodiscard]] int live_nodes() const { return static_cast<int>(nodes_.size() - free_.size()); }
  [[nodiscard]] int max_nodes() const { return static_cast<int>(nodes_.size()); }
  // Moves every pose into another frame: pose <- compose(change, pose).
  void change_frame(const Pose2& change);

  // One entry per node that went away since the list was last cleared.
  std::vector<int>& freed_slots() { return freed_slots_; }

 private:
  void free_node(int id);

  std::vector<Node> nodes_;
  std::vector<int> free_;
  std::vector<int> freed_slots_;
  int root_ = 0;
};

}  // namespace submapd
