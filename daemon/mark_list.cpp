#include "daemon/mark_list.hpp"

#include <algorithm>

namespace submapd {
namespace {

struct ByTime {
  bool operator()(const Mark& mark, std::int64_t utime_us) const { return mark.utime_us < utime_us; }
  bool operator()(std::int64_t utime_us, const Mark& mark) const { return utime_us < mark.utime_us; }
};

}  // namespace

std::optional<Mark> MarkList::find(const std::string& id, const std::string& name,
                                   std::optional<std::int64_t> utime_us) const {
  if (!id.empty()) {
    const auto request = std::find_if(newest_.begin(), newest_.end(), [&](const auto& of) { return of.first == id; });
    if (request != newest_.end() && request->second.name == name) return request->second;
  }
  if (!utime_us) return std::nullopt;
  const auto [first, last] = std::equal_range(marks_.begin(), marks_.end(), *utime_us, ByTime{});
  const auto same = std::find_if(first, last, [&](const Mark& mark) { return mark.name == name; });
  return same == last ? std::nullopt : std::optional(*same);
}

void MarkList::add(const std::string& id, const Mark& mark) {
  marks_.insert(std::upper_bound(marks_.begin(), marks_.end(), mark.utime_us, ByTime{}), mark);
  if (id.empty()) return;
  newest_.emplace_back(id, mark);
  if (newest_.size() > kRemembered) newest_.pop_front();
}

}  // namespace submapd
