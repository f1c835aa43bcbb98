// The tree against a model that keeps every particle's whole history.
#include "slam/filter/ancestry_tree.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <set>
#include <vector>

namespace submapd {
namespace {

constexpr int kMaxNodes = 24;

// Labels of all key-frames of one particle since the base map; labels are unique and serve as scan slots.
using History = std::vector<int>;

struct Model {
  AncestryTree tree{kMaxNodes};
  std::vector<History> histories;
  std::vector<int> heads;
  std::vector<double> label_x;  // pose of each label
  int root_label = -1;
  std::vector<int> baked;
  std::multiset<int> freed;

  explicit Model(int particles) : histories(static_cast<std::size_t>(particles)) {
    tree.reset({}, particles);
    heads.assign(histories.size(), tree.root());
  }

  [[nodiscard]] std::set<int> live_labels() const {
    std::set<int> live;
    for (const History& h : histories) live.insert(h.begin(), h.end());
    return live;
  }

  // A key-frame for every particle; the pool may run out on the way.
  void extend() {
    for (std::size_t i = 0; i < histories.size(); ++i) {
      const bool full = static_cast<int>(live_labels().size()) + 1 == kMaxNodes;
      const int label = static_cast<int>(label_x.size());
      const int id = tree.extend(heads[i], {static_cast<double>(label), 0.0, 0.0}, label);
      RC_ASSERT((id < 0) == full);
      if (full) return;
      label_x.push_back(label);
      histories[i].push_back(label);
      heads[i] = id;
    }
  }

  void resample(const std::vector<int>& ancestors) {
    std::vector<int> copies(histories.size());
    for (const int a : ancestors) ++copies[static_cast<std::size_t>(a)];
    for (std::size_t i = 0; i < copies.size(); ++i) {
      if (copies[i] == 0) tree.remove_head(heads[i]);
      for (int k = 1; k < copies[i]; ++k) tree.add_head(heads[i]);
    }
    std::vector<History> new_histories;
    std::vector<int> new_heads;
    for (const int a : ancestors) {
      new_histories.push_back(histories[static_cast<std::size_t>(a)]);
      new_heads.push_back(heads[static_cast<std::size_t>(a)]);
    }
    histories = std::move(new_histories);
    heads = std::move(new_heads);
  }

  void bake() {
    while (const auto id = tree.advance_root()) {
      RC_ASSERT(tree.root() == *id);
      root_label = tree.node(*id).scan_slot;
      baked.push_back(root_label);
      for (History& h : histories) {
        RC_ASSERT(!h.empty() && h.front() == root_label);
        h.erase(h.begin());
      }
    }
    // What all agree on is gone from the histories.
    bool agreed = true;
    for (const History& h : histories) agreed = agreed && !h.empty() && h.front() == histories[0].front();
    RC_ASSERT(!agreed);
  }

  void check() {
    for (const int slot : tree.freed_slots()) freed.insert(slot);
    tree.freed_slots().clear();
    const std::set<int> live = live_labels();
    RC_ASSERT(tree.live_nodes() == static_cast<int>(live.size()) + 1);
    RC_ASSERT(tree.live_nodes() <= kMaxNodes);
    // Every label is alive, or the root's, or was freed exactly once.
    for (std::size_t l = 0; l < label_x.size(); ++l) {
      const int label = static_cast<int>(l);
      const bool alive = live.count(label) > 0 || label == root_label;
      RC_ASSERT(freed.count(label) == (alive ? 0U : 1U));
    }
    // Each head leads up through its history to the root.
    for (std::size_t i = 0; i < heads.size(); ++i) {
      int id = heads[i];
      for (auto label = histories[i].rbegin(); label != histories[i].rend(); ++label) {
        RC_ASSERT(tree.node(id).scan_slot == *label);
        RC_ASSERT(tree.node(id).pose.x == label_x[static_cast<std::size_t>(*label)]);
        id = tree.node(id).parent;
      }
      RC_ASSERT(id == tree.root());
    }
  }
};

RC_GTEST_PROP(AncestryTreeTest, AgreesWithWholeHistories, ()) {
  const int particles = *rc::gen::inRange(1, 6);
  Model model(particles);
  const auto steps = *rc::gen::container<std::vector<int>>(40, rc::gen::inRange(0, 4));
  for (const int step : steps) {
    if (step <= 1) {
      model.extend();
    } else if (step == 2) {
      model.resample(
          *rc::gen::container<std::vector<int>>(static_cast<std::size_t>(particles), rc::gen::inRange(0, particles)));
    } else {
      model.bake();
    }
    model.check();
  }
}

TEST(AncestryTreeTest, OneParticleNeedsTwoNodes) {
  AncestryTree tree(2);
  tree.reset({}, 1);
  int head = tree.root();
  for (int k = 0; k < 100; ++k) {
    head = tree.extend(head, {0.1 * k, 0.0, 0.0}, k);
    ASSERT_GE(head, 0);
    EXPECT_EQ(tree.extend(head, {}, 1000), -1) << "the pool holds two";
    ASSERT_EQ(tree.advance_root(), head);
    ASSERT_EQ(tree.advance_root(), std::nullopt);
    EXPECT_EQ(tree.live_nodes(), 1);
  }
  EXPECT_EQ(tree.freed_slots().size(), 99U) << "all but the root's";
}

TEST(AncestryTreeTest, ChangeOfFrameMovesEveryPose) {
  AncestryTree tree(4);
  tree.reset({1.0, 0.0, 0.0}, 1);
  const int head = tree.extend(tree.root(), {2.0, 0.0, 0.0}, 0);
  tree.change_frame({10.0, 0.0, std::numbers::pi / 2.0});
  EXPECT_NEAR(tree.node(tree.root()).pose.y, 1.0, 1e-12);
  EXPECT_NEAR(tree.node(head).pose.x, 10.0, 1e-12);
  EXPECT_NEAR(tree.node(head).pose.y, 2.0, 1e-12);
}

}  // namespace
}  // namespace submapd
