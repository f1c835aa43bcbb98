#include "slam/filter/ancestry_tree.hpp"

namespace submapd {

AncestryTree::AncestryTree(int max_nodes) : nodes_(static_cast<std::size_t>(max_nodes)) {
  free_.reserve(nodes_.size());
  freed_slots_.reserve(nodes_.size());
  reset({}, 0);
}

void AncestryTree::reset(const Pose2& root_pose, int heads) {
  free_.clear();
  freed_slots_.clear();
  for (int i = static_cast<int>(nodes_.size()) - 1; i >= 1; --i) free_.push_back(i);
  root_ = 0;
  nodes_[0] = Node{};
  nodes_[0].pose = root_pose;
  nodes_[0].heads = heads;
}

int AncestryTree::extend(int parent, const Pose2& pose, int scan_slot) {
  if (free_.empty()) return -1;
  const int id = free_.back();
  free_.pop_back();
  Node& node = nodes_[static_cast<std::size_t>(id)];
  node = Node{};
  node.pose = pose;
  node.parent = parent;
  node.heads = 1;
  node.scan_slot = scan_slot;
  Node& above = nodes_[static_cast<std::size_t>(parent)];
  ++above.children;
  --above.heads;
  return id;
}

void AncestryTree::free_node(int id) {
  Node& node = nodes_[static_cast<std::size_t>(id)];
  if (node.scan_slot >= 0) freed_slots_.push_back(node.scan_slot);
  free_.push_back(id);
}

void AncestryTree::remove_head(int node_id) {
  --nodes_[static_cast<std::size_t>(node_id)].heads;
  int id = node_id;
  while (id != root_) {
    Node& node = nodes_[static_cast<std::size_t>(id)];
    if (node.heads > 0 || node.children > 0) return;
    const int parent = node.parent;
    free_node(id);
    --nodes_[static_cast<std::size_t>(parent)].children;
    id = parent;
  }
}

std::optional<int> AncestryTree::advance_root() {
  const Node& root = nodes_[static_cast<std::size_t>(root_)];
  if (root.heads != 0 || root.children != 1) return std::nullopt;
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    Node& child = nodes_[i];
    if (child.parent != root_ || (child.heads == 0 && child.children == 0)) continue;
    const int old = root_;
    root_ = static_cast<int>(i);
    child.parent = -1;
    Node& gone = nodes_[static_cast<std::size_t>(old)];
    gone.children = 0;
    gone.parent = -1;
    free_node(old);
    return root_;
  }
  return std::nullopt;
}

void AncestryTree::drop_root_scan() {
  Node& root = nodes_[static_cast<std::size_t>(root_)];
  if (root.scan_slot >= 0) freed_slots_.push_back(root.scan_slot);
  root.scan_slot = -1;
}

void AncestryTree::change_frame(const Pose2& change) {
  for (Node& node : nodes_) node.pose = compose(change, node.pose);
}

}  // namespace submapd
