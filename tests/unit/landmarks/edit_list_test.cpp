#include "tools/landmarks/edit_list.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace submapd::tools {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Pair;

ManualTie tie(std::uint32_t a, std::uint32_t b, double sigma_m = 0.1) {
  return {a, b, sigma_m, {{{0.0, 0.0}, {1.0, 0.0}}, {{2.0, 0.0}, {3.0, 0.0}}}};
}

EditList after(const std::vector<JournalEvent>& events) {
  std::vector<JournalRecord> records;
  for (const JournalEvent& event : events) records.push_back({0, event});
  return edits_of(records);
}

TEST(EditList, OtherRecordsAreNoEdits) {
  const EditList list = after({RunStarted{}, SubmapSaved{}, RunEnded{}});
  EXPECT_THAT(list.edits, IsEmpty());
  EXPECT_THAT(list.graph.ties, IsEmpty());
}

TEST(EditList, ASecondTieOfAPairReplacesTheFirst) {
  const EditList list = after({LandmarksAdded{tie(1, 5)}, LandmarksAdded{tie(1, 5, 0.02)}, LandmarksAdded{tie(2, 9)}});
  EXPECT_THAT(list.graph.ties, ElementsAre(tie(1, 5, 0.02), tie(2, 9)));
}

TEST(EditList, RemovedPairsMayBeTiedByHandAgainForbiddenOnesNot) {
  const std::vector<JournalEvent> removed = {LandmarksAdded{tie(1, 5)}, PairRemoved{1, 5}};
  EXPECT_THAT(after(removed).graph.ties, IsEmpty());
  EXPECT_THAT(after(removed).graph.barred, ElementsAre(Pair(1, 5)));
  EXPECT_TRUE(after({PairRemoved{1, 5}, LandmarksAdded{tie(1, 5)}}).has_tie({1, 5}));
  const EditList forbidden = after({PairForbidden{1, 5}, LandmarksAdded{tie(1, 5)}});
  EXPECT_FALSE(forbidden.has_tie({1, 5}));
  EXPECT_TRUE(forbidden.forbidden.contains({1, 5}));
}

TEST(EditList, UndoTakesBackTheNewestEditThatCounts) {
  std::vector<JournalEvent> events = {LandmarksAdded{tie(1, 5)}, PairForbidden{2, 9}, EditUndone{}};
  EXPECT_THAT(after(events).forbidden, IsEmpty());
  EXPECT_TRUE(after(events).has_tie({1, 5}));
  events.emplace_back(EditUndone{});
  EXPECT_THAT(after(events).edits, IsEmpty());
  events.emplace_back(EditUndone{});  // of nothing
  events.emplace_back(LandmarksAdded{tie(3, 4)});
  EXPECT_THAT(after(events).graph.ties, ElementsAre(tie(3, 4)));
}

// What was there before the edit that is undone is there again.
TEST(EditList, UndoneReplacementsAndRemovalsBringTheOldTieBack) {
  EXPECT_THAT(after({LandmarksAdded{tie(1, 5)}, LandmarksAdded{tie(1, 5, 0.02)}, EditUndone{}}).graph.ties,
              ElementsAre(tie(1, 5)));
  const EditList list = after({LandmarksAdded{tie(1, 5)}, PairRemoved{1, 5}, EditUndone{}});
  EXPECT_TRUE(list.has_tie({1, 5}));
  EXPECT_THAT(list.graph.barred, IsEmpty());
}

TEST(EditList, APairInTheWrongOrderIsLeftOut) {
  EXPECT_THAT(after({LandmarksAdded{tie(5, 5)}, LandmarksAdded{tie(6, 5)}}).graph.ties, IsEmpty());
}

}  // namespace
}  // namespace submapd::tools
