// Line-oriented text files of numbers, read defensively: bounded lines, every number checked, errors with their line.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <istream>
#include <string>
#include <string_view>

#include "slam/base/status.hpp"

namespace submapd::internal {

// Finite doubles and integers; the whole of `text` must be the number.
[[nodiscard]] bool parse_number(std::string_view text, double& value);
[[nodiscard]] bool parse_number(std::string_view text, std::uint64_t& value);

// Hands out the lines of a stream and the blank-separated fields of the current line.
class TextParser {
 public:
  TextParser(std::istream& in, std::string_view name) : in_(in), name_(name) {}

  // Moves to the next line that has a field and is no '#' comment; false at the end or after an error.
  [[nodiscard]] bool next_line();
  // Next field of the line; empty: there is none.
  [[nodiscard]] std::string_view next_field();
  // Next field as a number; false if it is none.
  template <typename T>
  [[nodiscard]] bool next(T& value) {
    return parse_number(next_field(), value);
  }
  [[nodiscard]] bool at_line_end();

  // How reading ended: an over-long line, a failed stream, a last line without its newline are errors.
  [[nodiscard]] const Status& status() const { return status_; }
  // kCorrupt with the file's name and the line's number.
  [[nodiscard]] Status error(std::string_view what) const;

 private:
  static constexpr std::size_t kLongestLine = 4096;

  std::istream& in_;
  std::string name_;
  std::array<char, kLongestLine> line_{};
  std::string_view rest_;
  std::uint64_t line_number_ = 0;
  Status status_;
};

}  // namespace submapd::internal
