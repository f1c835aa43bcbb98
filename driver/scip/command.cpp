#include "driver/scip/command.hpp"

#include <algorithm>

#include "driver/scip/code.hpp"

namespace submapd::driver::scip {
namespace {

constexpr std::size_t kMaxTag = 16;

// Takes decimal digits off the front of a text.
class DigitReader {
 public:
  explicit DigitReader(std::string_view text) : text_(text) {}

  int take(std::size_t digits) {
    int value = 0;
    for (std::size_t i = 0; i < digits; ++i) {
      const char c = i < text_.size() ? text_[i] : '?';
      if (c < '0' || c > '9') ok_ = false;
      value = 10 * value + (c - '0');
    }
    text_.remove_prefix(std::min(digits, text_.size()));
    return value;
  }

  [[nodiscard]] bool ok() const { return ok_; }
  [[nodiscard]] std::string_view rest() const { return text_; }

 private:
  std::string_view text_;
  bool ok_ = true;
};

bool is_tag(std::string_view rest) {
  return rest.empty() || (rest.front() == ';' && rest.size() <= 1 + kMaxTag);
}

std::optional<ScanRequest> parse_scan(std::string_view text) {
  ScanRequest request;
  request.microseconds = text.starts_with('%');
  if (request.microseconds) text.remove_prefix(1);
  if (text.size() < 2) return std::nullopt;
  request.mode = text[0];
  request.data = text[1];
  const std::string_view modes = request.microseconds ? "MN" : "MNGH";
  if (modes.find(request.mode) == modes.npos || std::string_view("DSE").find(request.data) == std::string_view::npos) {
    return std::nullopt;
  }
  DigitReader digits(text.substr(2));
  request.first_step = digits.take(4);
  request.last_step = digits.take(4);
  request.cluster = digits.take(2);
  if (request.streams()) {
    request.interval = digits.take(1);
    request.number = digits.take(2);
  }
  if (!digits.ok() || !is_tag(digits.rest())) return std::nullopt;
  return request;
}

}  // namespace

std::size_t ScanRequest::beams() const {
  const int steps = std::max(0, last_step - first_step + 1);
  const int width = std::max(1, cluster);
  return static_cast<std::size_t>((steps + width - 1) / width);
}

std::optional<Command> Command::parse(std::string_view text) {
  if (text.empty() || text.size() > kCapacity || !std::all_of(text.begin(), text.end(), is_printable)) {
    return std::nullopt;
  }
  Command command;
  command.append(text);
  command.classify();
  return command;
}

Command Command::scan(const ScanRequest& request, std::string_view tag) {
  Command command;
  if (request.microseconds) command.append("%");
  const std::array<char, 2> name{request.mode, request.data};
  command.append({name.data(), name.size()});
  command.append_digits(request.first_step, 4);
  command.append_digits(request.last_step, 4);
  command.append_digits(request.cluster, 2);
  if (request.streams()) {
    command.append_digits(request.interval, 1);
    command.append_digits(request.number, 2);
  }
  if (!tag.empty()) {
    command.append(";");
    command.append(tag.substr(0, kMaxTag));
  }
  command.classify();
  return command;
}

bool Command::same_stream(const Command& other) const {
  // The sensor replaces the number by the scans still to come; all else comes back as it was sent.
  ScanRequest counted = other.request_;
  counted.number = request_.number;
  const std::size_t head = (request_.microseconds ? 1U : 0U) + 15U;
  return request_ == counted && text().substr(head) == other.text().substr(head);
}

void Command::append(std::string_view text) {
  const std::size_t room = std::min(text.size(), kCapacity - size_);
  std::copy_n(text.begin(), room, text_.begin() + size_);
  size_ = static_cast<std::uint8_t>(size_ + room);
}

void Command::append_digits(int value, int digits) {
  std::array<char, 4> text{};
  for (int i = digits; i-- > 0; value /= 10) text[static_cast<std::size_t>(i)] = static_cast<char>('0' + value % 10);
  append({text.data(), static_cast<std::size_t>(digits)});
}

void Command::classify() {
  const std::string_view name = text();
  if (const std::optional<ScanRequest> request = parse_scan(name)) {
    request_ = *request;
    kind_ = request->streams() ? CommandKind::kScanStream : CommandKind::kScanOnce;
  } else if (name.starts_with("VV") || name.starts_with("PP") || name.starts_with("II")) {
    kind_ = CommandKind::kParameters;
  } else if (name.starts_with("TM1") || name.starts_with("%TM1")) {
    kind_ = CommandKind::kTime;
  }
}

}  // namespace submapd::driver::scip
