// The command side of the emulated sensor: what it answers and which state it goes to.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <string>
#include <utility>

#include "driver/scip/encode.hpp"
#include "driver/sim/sim_sensor.hpp"

namespace submapd::driver {
namespace {

bool all_digits(std::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; });
}

int number(std::string_view digits) {
  int value = 0;
  std::from_chars(digits.data(), digits.data() + digits.size(), value);
  return value;
}

// "" or the status that refuses the string after the semicolon.
std::string_view refuse_string(std::string_view suffix) {
  if (suffix.size() > 17) {
    return "0G";
  }
  const std::string_view letters = suffix.empty() ? suffix : suffix.substr(1);
  const bool good = std::all_of(letters.begin(), letters.end(), [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 ||
           std::string_view(" ._+@").find(c) != std::string_view::npos;
  });
  return good ? "" : "0H";
}

bool is_scan_name(std::string_view name) {
  return name.size() == 2 && (name[0] == 'M' || name[0] == 'G') && (name[1] == 'D' || name[1] == 'S' || name[1] == 'E');
}

}  // namespace

void SimSensor::execute(const Command& command, std::int64_t now_ns) {
  if (now_ns < silent_until_ns_) {
    return;
  }
  if (scip11_) {
    execute_scip11(command.text, now_ns);
    return;
  }
  const std::size_t semicolon = command.text.find(';');
  const std::string suffix = semicolon == std::string::npos ? "" : command.text.substr(semicolon);
  const std::string words = command.text.substr(0, semicolon);
  const bool scip2 = words == "SCIP2.0";
  const std::string name = scip2 ? words : words.substr(0, 2);
  const std::string arguments = words.substr(name.size());
  if (hang_ && !heard_through_hang(name)) {
    return;
  }
  const bool asks = name == "VV" || name == "PP" || name == "II";
  std::string status(refuse_string(suffix));
  if (status.empty() && abnormal_ && !asks && name != "RB") {
    status = "0L";
  }
  if (status.empty() && is_scan_name(name)) {
    Stream stream;
    status = state_ == State::kTimeMode ? "0E" : start_stream(words, suffix, stream);
    if (status == "00" && name[0] == 'M') {
      stream_ = std::move(stream);
      state_ = State::kStreaming;
    } else if (status == "00") {
      send_scan(command.text, "00", stream, now_ns);
      return;
    }
  }
  if (status.empty()) {
    status = scip2 ? "0E" : status_of(name, arguments, now_ns);
  }
  std::string reply;
  if (words == "TM1" && status == "00") {
    scip::append_time(reply, command.text, device_ms(now_ns));
  } else if (asks && status == "00") {
    append_parameters(reply, command.text, now_ns);
  } else {
    scip::append_status(reply, command.text, status);
  }
  send(reply, now_ns);
  if (name == "RB" && status == "00") {
    restart(now_ns, 0);
  }
}

void SimSensor::execute_scip11(const std::string& text, std::int64_t now_ns) {
  if (text == "SCIP2.0") {
    scip11_ = false;
    send("SCIP2.0\n0\n\n", now_ns);
  } else if (text == "V") {
    send("V\n0\nVEND:Hokuyo Automatic Co.,Ltd.\nPROD:" + options_.product + "\nFIRM:" + options_.firmware +
             "\nPROT:00003,(SCIP 1.0)\nSERI:" + options_.serial + "\n\n",
         now_ns);
  } else {
    send(text + "\nE\n\n", now_ns);  // one character and no sum
  }
}

bool SimSensor::heard_through_hang(const std::string& name) {
  const bool reset = name == "RS" || name == "RT";
  bool frees = reset && *hang_ <= SimRemedy::kRs;
  frees = frees || (name == "QT" && *hang_ <= SimRemedy::kQt);
  frees = frees || (is_scan_name(name) && *hang_ == SimRemedy::kMd);
  const bool heard = frees || *hang_ == SimRemedy::kMd;
  if (frees) {
    hang_.reset();
  }
  return heard;
}

std::string SimSensor::time_mode_status(const std::string& name) {
  if (name == "0") {
    if (state_ == State::kTimeMode) {
      return "02";
    }
    if (state_ == State::kStreaming) {
      return "10";
    }
    state_ = State::kTimeMode;
    return "00";
  }
  if (name == "1") {
    return state_ == State::kTimeMode ? "00" : "04";
  }
  if (name == "2") {
    if (state_ != State::kTimeMode) {
      return "03";
    }
    state_ = State::kIdle;
    return "00";
  }
  return "01";
}

std::string SimSensor::status_of(const std::string& name, const std::string& arguments, std::int64_t now_ns) {
  if (name == "TM") {
    return time_mode_status(arguments);
  }
  if (name == "RS" || name == "RT") {
    state_ = State::kIdle;
    clock_zero_ns_ = now_ns;
    clock_start_ms_ = 0;
    ++epoch_;
    trouble_ = false;
    fault_mode_ = 10;
    return "00";
  }
  if (name == "RB") {
    if (!options_.reboot_supported) {
      return "0E";
    }
    return ++reboots_asked_ % 2 == 0 ? "00" : "01";
  }
  if (state_ == State::kTimeMode) {
    return "0E";
  }
  if (name == "VV" || name == "PP" || name == "II") {
    return arguments.empty() ? "00" : "0E";
  }
  if (name == "BM") {
    if (trouble_) {
      return "01";
    }
    if (state_ != State::kIdle) {
      return "02";
    }
    state_ = State::kLaserOn;
    return "00";
  }
  if (name == "QT") {
    state_ = State::kIdle;
    return "00";
  }
  if (name == "SS") {
    return !all_digits(arguments) ? "01" : "04";  // USB only
  }
  if (name == "CR") {
    return !all_digits(arguments) ? "01" : "04";  // as the captured UTM-30LX
  }
  if (name == "HS") {
    return arguments == "0" || arguments == "1" ? "03" : "01";
  }
  if (name == "DB") {
    const int mode = all_digits(arguments) ? number(arguments) : 0;
    if (mode != 2 && mode != 3 && mode != 4 && mode != 5 && mode != 10) {
      return "01";
    }
    fault_mode_ = mode;
    return "00";
  }
  return "0E";
}

void SimSensor::append_parameters(std::string& reply, const std::string& echo, std::int64_t now_ns) const {
  if (echo.starts_with("VV")) {
    scip::append_parameters(reply, echo,
                            {{{"VEND", "Hokuyo Automatic Co.,Ltd."},
                              {"PROD", options_.product},
                              {"FIRM", options_.firmware},
                              {"PROT", "SCIP 2.0"},
                              {"SERI", options_.serial}}});
  } else if (echo.starts_with("PP")) {
    scip::append_parameters(reply, echo,
                            {{{"MODL", options_.model},
                              {"DMIN", "23"},
                              {"DMAX", "60000"},
                              {"ARES", "1440"},
                              {"AMIN", "0"},
                              {"AMAX", "1080"},
                              {"AFRT", "540"},
                              {"SCAN", "2400"}}});
  } else {
    const bool on = state_ == State::kLaserOn || state_ == State::kStreaming;
    const char* const state = abnormal_  ? "Abnormal"
                              : trouble_ ? "Trouble!! Error No. =[00->33]"
                                         : "Sensor works well.";
    const std::string time = fmt::format("{:06X}", device_ms(now_ns));
    scip::append_parameters(reply, echo,
                            {{{"MODL", options_.model},
                              {"LASR", on ? "ON" : "OFF"},
                              {"SCSP", "Initial(2400[rpm])<-Default setting by user"},
                              {"MESM", on ? "CLASSIC" : "IDLE"},
                              {"SBPS", "USB Full Speed"},
                              {"TIME", time},
                              {"STAT", state}}});
  }
}

// MDsssseeeeccinn or GDsssseeeecc: fills `stream` and gives 00, or the status that refuses it.
std::string SimSensor::start_stream(const std::string& text, const std::string& suffix, Stream& stream) const {
  const bool continuous = text[0] == 'M';
  const std::size_t length = continuous ? 15 : 12;
  if (text.size() < length) {
    return "0C";
  }
  if (text.size() > length) {
    return "0D";
  }
  const std::string_view words = text;
  const std::string_view first = words.substr(2, 4);
  const std::string_view last = words.substr(6, 4);
  const std::string_view cluster = words.substr(10, 2);
  if (!all_digits(first)) {
    return "01";
  }
  if (!all_digits(last)) {
    return "02";
  }
  if (!all_digits(cluster)) {
    return "03";
  }
  stream.kind = text[1];
  stream.first = number(first);
  stream.last = number(last);
  stream.cluster = std::max(1, number(cluster));
  stream.suffix = suffix;
  if (stream.last >= static_cast<int>(kSteps)) {
    return "04";
  }
  if (stream.last < stream.first) {
    return "05";
  }
  if (!continuous) {
    return state_ == State::kLaserOn || state_ == State::kStreaming ? "00" : "10";
  }
  if (!all_digits(words.substr(12, 1))) {
    return "06";
  }
  if (!all_digits(words.substr(13, 2))) {
    return "07";
  }
  stream.interval = number(words.substr(12, 1));
  stream.remaining = number(words.substr(13, 2));
  stream.limited = stream.remaining > 0;
  stream.head = text.substr(0, 13);
  return "00";
}

}  // namespace submapd::driver
