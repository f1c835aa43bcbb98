// The marks of a run, each set once however often it is asked for: who lost a reply asks again.
//
// One thread.
#pragma once

#include <cstddef>
#include <deque>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "slam/output/run_outputs.hpp"

namespace submapd {

class MarkList {
 public:
  static constexpr std::size_t kMost = 10'000;
  static constexpr std::size_t kRemembered = 64;  // requests whose repetition is known

  // REQUIRES: `marks` in order of time.
  explicit MarkList(std::vector<Mark> marks) : marks_(std::move(marks)) {}

  // The mark that a request has set already: one of the newest requests had its `id` (not empty) and name, or there is
  // a mark of that name at that very instant.
  [[nodiscard]] std::optional<Mark> find(const std::string& id, const std::string& name,
                                         std::optional<std::int64_t> utime_us) const;
  [[nodiscard]] bool full() const { return marks_.size() >= kMost; }
  // REQUIRES: not full().
  void add(const std::string& id, const Mark& mark);

  [[nodiscard]] const std::vector<Mark>& in_order() const { return marks_; }

 private:
  std::vector<Mark> marks_;
  std::deque<std::pair<std::string, Mark>> newest_;  // requests with an id
};

}  // namespace submapd
