#include "tools/landmarks/edit_list.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace submapd::tools {
namespace {

bool is_edit(const JournalEvent& event) {
  return std::holds_alternative<LandmarksAdded>(event) || std::holds_alternative<PairRemoved>(event) ||
         std::holds_alternative<PairForbidden>(event);
}

void drop_tie(GraphEdits& edits, const SubmapPair& pair) {
  std::erase_if(edits.ties, [&](const ManualTie& tie) { return SubmapPair(tie.a, tie.b) == pair; });
}

struct Apply {
  EditList& list;
  void operator()(const LandmarksAdded& e) const {
    const SubmapPair pair(e.tie.a, e.tie.b);
    if (pair.first >= pair.second || list.forbidden.contains(pair)) return;
    set_tie(list.graph, e.tie);
  }
  void operator()(const PairRemoved& e) const { bar({e.a, e.b}); }
  void operator()(const PairForbidden& e) const {
    bar({e.a, e.b});
    list.forbidden.insert({e.a, e.b});
  }
  template <typename Other>
  void operator()(const Other& /*no edit*/) const {}

  void bar(const SubmapPair& pair) const {
    drop_tie(list.graph, pair);
    auto& barred = list.graph.barred;
    if (std::find(barred.begin(), barred.end(), pair) == barred.end()) barred.push_back(pair);
  }
};

}  // namespace

bool EditList::has_tie(const SubmapPair& pair) const {
  return std::any_of(graph.ties.begin(), graph.ties.end(),
                     [&](const ManualTie& tie) { return SubmapPair(tie.a, tie.b) == pair; });
}

void set_tie(GraphEdits& edits, const ManualTie& tie) {
  drop_tie(edits, {tie.a, tie.b});
  edits.ties.push_back(tie);
}

EditList edits_of(const std::vector<JournalRecord>& records) {
  EditList list;
  for (const JournalRecord& record : records) {
    if (is_edit(record.event)) list.edits.push_back(record.event);
    if (std::holds_alternative<EditUndone>(record.event) && !list.edits.empty()) list.edits.pop_back();
  }
  for (const JournalEvent& edit : list.edits) std::visit(Apply{list}, edit);
  return list;
}

std::optional<std::string> words_of(const JournalEvent& event) {
  if (const auto* const e = std::get_if<LandmarksAdded>(&event)) {
    return fmt::format("tie of sub-maps {} and {} by {} points of {:.0f} cm", e->tie.a, e->tie.b, e->tie.points.size(),
                       100.0 * e->tie.sigma_m);
  }
  if (const auto* const e = std::get_if<PairRemoved>(&event)) return fmt::format("removal of {} and {}", e->a, e->b);
  if (const auto* const e = std::get_if<PairForbidden>(&event)) return fmt::format("ban on {} and {}", e->a, e->b);
  return std::nullopt;
}

}  // namespace submapd::tools
