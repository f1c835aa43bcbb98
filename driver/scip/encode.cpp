#include "driver/scip/encode.hpp"

namespace submapd::driver::scip {
namespace {

// Cuts a run of characters into lines of 64, each with its sum.
class BlockWriter {
 public:
  explicit BlockWriter(std::string& out) : out_(out) {}

  void put(char c) {
    out_.push_back(c);
    sum_ += static_cast<unsigned char>(c);
    if (++length_ == kBlock) end_line();
  }

  void put_value(std::uint64_t value, std::size_t characters) {
    encode(value, characters, [this](char c) { put(c); });
  }

  // A total that is a multiple of 64 leaves no empty last line.
  void finish() {
    if (length_ > 0) end_line();
  }

 private:
  void end_line() {
    out_.push_back(static_cast<char>((sum_ & kCodeMask) + kCodeOffset));
    out_.push_back('\n');
    sum_ = 0;
    length_ = 0;
  }

  std::string& out_;
  unsigned sum_ = 0;
  std::size_t length_ = 0;
};

void append_head(std::string& out, std::string_view echo, std::string_view status) {
  out.append(echo);
  out.push_back('\n');
  append_line(out, status);
}

void append_time_line(std::string& out, std::uint64_t time, std::size_t characters) {
  const std::size_t begin = out.size();
  encode(time, characters, [&out](char c) { out.push_back(c); });
  out.push_back(checksum(std::string_view(out).substr(begin)));
  out.push_back('\n');
}

}  // namespace

void append_line(std::string& out, std::string_view text) {
  out.append(text);
  out.push_back(checksum(text));
  out.push_back('\n');
}

void append_status(std::string& out, std::string_view echo, std::string_view status) {
  append_head(out, echo, status);
  out.push_back('\n');
}

void append_parameters(std::string& out, std::string_view echo, std::span<const Parameter> parameters,
                       std::string_view status) {
  append_head(out, echo, status);
  for (const Parameter& parameter : parameters) {
    const std::size_t begin = out.size();
    out.append(parameter.key);
    out.push_back(':');
    out.append(parameter.value);
    const char sum = checksum(std::string_view(out).substr(begin));  // leaves out the ';'
    out.push_back(';');
    out.push_back(sum);
    out.push_back('\n');
  }
  out.push_back('\n');
}

void append_time(std::string& out, std::string_view echo, std::uint64_t time, std::size_t characters) {
  append_head(out, echo, "00");
  append_time_line(out, time, characters);
  out.push_back('\n');
}

void append_scan(std::string& out, const ScanFrame& frame) {
  append_head(out, frame.echo, frame.status);
  append_time_line(out, frame.time, frame.time_characters);
  BlockWriter data(out);
  std::size_t beam = 0;
  std::size_t echoes_left = 0;  // of this beam
  for (std::size_t i = 0; i < frame.ranges_mm.size(); ++i) {
    if (!frame.echo_counts.empty()) {
      if (echoes_left > 0) {
        data.put('&');
      } else if (beam < frame.echo_counts.size()) {
        echoes_left = frame.echo_counts[beam++];
      }
      if (echoes_left > 0) --echoes_left;
    }
    data.put_value(frame.ranges_mm[i], frame.value_characters);
    if (!frame.intensities.empty()) data.put_value(frame.intensities[i], frame.value_characters);
  }
  data.finish();
  out.push_back('\n');
}

std::size_t scan_bytes(std::size_t echo_characters, std::size_t data_characters, std::size_t time_characters) {
  const std::size_t lines = (data_characters + kBlock - 1) / kBlock;
  constexpr std::size_t kStatusLine = 4;
  return echo_characters + 1 + kStatusLine + time_characters + 2 + data_characters + 2 * lines + 1;
}

}  // namespace submapd::driver::scip
