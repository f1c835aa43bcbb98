// The edits of a run's graph that count, from its journal (daemon/journal-format.md, types 12 to 15). Pure functions.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "daemon/run_journal.hpp"
#include "slam/graph/optimizer.hpp"

namespace submapd::tools {

using SubmapPair = std::pair<std::uint32_t, std::uint32_t>;  // (a, b), a < b

struct EditList {
  GraphEdits graph;
  std::set<SubmapPair> forbidden;
  std::vector<JournalEvent> edits;  // those that are not undone, in order

  [[nodiscard]] bool has_tie(const SubmapPair& pair) const;
};

// The pair is tied by this one, whatever tied it by hand before.
void set_tie(GraphEdits& edits, const ManualTie& tie);

[[nodiscard]] EditList edits_of(const std::vector<JournalRecord>& records);

// "tie of sub-maps 3 and 17 by 12 points", for people; nothing of events that are no edits.
[[nodiscard]] std::optional<std::string> words_of(const JournalEvent& event);

}  // namespace submapd::tools
