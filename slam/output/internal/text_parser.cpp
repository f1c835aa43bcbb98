#include "slam/output/internal/text_parser.hpp"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <system_error>

namespace submapd::internal {
namespace {

constexpr std::string_view kBlanks = " \t\r";

template <typename T>
bool parse_whole(std::string_view text, T& value) {
  const char* const end = text.data() + text.size();
  const auto [stopped, error] = std::from_chars(text.data(), end, value);
  return error == std::errc() && stopped == end;
}

}  // namespace

bool parse_number(std::string_view text, double& value) {
  return parse_whole(text, value) && std::isfinite(value);
}

bool parse_number(std::string_view text, std::uint64_t& value) {
  return parse_whole(text, value);
}

bool TextParser::next_line() {
  while (status_.ok()) {
    in_.getline(line_.data(), static_cast<std::streamsize>(line_.size()));
    const std::streamsize taken = in_.gcount();  // with the newline
    if (in_.eof() && taken == 0) return false;
    ++line_number_;
    if (in_.bad()) {
      status_ = Status(StatusCode::kIo, fmt::format("{}:{}: cannot read", name_, line_number_));
    } else if (in_.eof()) {
      status_ = error("the file ends inside a line: it is cut off");
    } else if (in_.fail()) {
      status_ = error("the line is too long");
    } else {
      rest_ = std::string_view(line_.data(), static_cast<std::size_t>(taken - 1));
      if (!at_line_end() && rest_.front() != '#') return true;
    }
  }
  return false;
}

bool TextParser::at_line_end() {
  const std::size_t start = rest_.find_first_not_of(kBlanks);
  rest_.remove_prefix(start == std::string_view::npos ? rest_.size() : start);
  return rest_.empty();
}

std::string_view TextParser::next_field() {
  if (at_line_end()) return {};
  const std::string_view field = rest_.substr(0, rest_.find_first_of(kBlanks));
  rest_.remove_prefix(field.size());
  return field;
}

Status TextParser::error(std::string_view what) const {
  return Status(StatusCode::kCorrupt, fmt::format("{}:{}: {}", name_, line_number_, what));
}

}  // namespace submapd::internal
