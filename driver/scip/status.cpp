#include "driver/scip/status.hpp"

#include <algorithm>

namespace submapd::driver::scip {
namespace {

using enum StatusMeaning;

struct Row {
  std::string_view commands;  // names divided by blanks; empty: every command
  std::string_view first;
  std::string_view last;
  StatusInfo info;
};

constexpr std::string_view kScans = "MD MS ME GD GS GE ND NE NS HD HE HS";
constexpr std::string_view kStreams = "MD MS ME ND NE NS";

// The first row that fits counts: what a command gives a meaning of its own stands before what all share.
constexpr Row kRows[] = {
    {"HS0 HS1", "02", "02", {kAlready, "sensitivity is set so already"}},
    {"HS0 HS1", "03", "03", {kNotSupported, "no high sensitivity on this model"}},
    {"HS0 HS1", "01", "01", {kBadParameter, "bad sensitivity code"}},
    {kScans, "01", "01", {kBadParameter, "start step is not numeric"}},
    {kScans, "02", "02", {kBadParameter, "end step is not numeric"}},
    {kScans, "03", "03", {kBadParameter, "cluster count is not numeric"}},
    {kScans, "04", "04", {kBadParameter, "end step is out of range"}},
    {kScans, "05", "05", {kBadParameter, "end step is below start step"}},
    {kStreams, "06", "06", {kBadParameter, "scan interval is not numeric"}},
    {kStreams, "07", "07", {kBadParameter, "number of scans is not numeric"}},
    {kStreams, "21", "49", {kPaused, "stopped to check an error"}},
    {kStreams, "50", "97", {kHardwareTrouble, "hardware trouble (laser, motor)"}},
    {kStreams, "98", "98", {kResumed, "going on after a check"}},
    {kStreams, "99", "99", {kData, "scan"}},
    {"GD GS GE HD HE", "10", "10", {kLaserOff, "the laser is off"}},
    {"GD GS GE HD HE", "50", "98", {kHardwareTrouble, "hardware trouble (laser, motor)"}},
    {"BM", "01", "01", {kHardwareTrouble, "laser cannot light"}},
    {"BM", "02", "02", {kAlready, "laser is on already"}},
    {"TM", "01", "01", {kBadParameter, "bad time mode code"}},
    {"TM", "02", "02", {kAlready, "time mode is on already"}},
    {"TM", "03", "03", {kAlready, "time mode is off already"}},
    {"TM", "04", "04", {kTimeModeOff, "time asked outside time mode"}},
    {"SS", "01", "02", {kBadParameter, "bad bit rate"}},
    {"SS", "03", "03", {kAlready, "bit rate is set so already"}},
    {"SS", "04", "04", {kNotSupported, "no bit rate on this model"}},
    {"CR", "01", "02", {kBadParameter, "bad motor speed"}},
    {"CR", "03", "03", {kAlready, "motor speed is set so already"}},
    {"CR", "04", "04", {kNotSupported, "motor speed is fixed on this model"}},
    {"DB", "01", "05", {kBadParameter, "fault cannot be simulated"}},
    {"RB", "01", "01", {kOk, "send it again within one second to reboot"}},
    {"", "00", "00", {kOk, "done"}},
    {"SCIP2.0", "0", "0", {kOk, "left SCIP 1.1"}},
    {"SCIP2.0", "0E", "0E", {kAlready, "speaks SCIP 2.0 already"}},
    {"", "0A", "0A", {kInternalError, "internal error"}},
    {"", "0B", "0B", {kInternalError, "buffer too short, or command repeated too soon"}},
    {"", "0C", "0C", {kBadParameter, "too few parameters"}},
    {"", "0D", "0D", {kNotSupported, "command not defined, or too long"}},
    {"", "0E", "0E", {kNotSupported, "command not defined"}},
    {"", "0F", "0F", {kNotSupported, "command not supported"}},
    {"", "0G", "0H", {kBadParameter, "string behind the command is refused"}},
    {"", "0I", "0I", {kFirmwareUpdate, "firmware update mode"}},
    {"", "0L", "0L", {kAbnormal, "abnormal state"}},
    {"", "0M", "0M", {kUnstable, "unstable state"}},
    {"", "10", "10", {kDenied, "denied in this state"}},
};

bool applies(std::string_view commands, std::string_view command) {
  if (commands.empty()) return true;
  while (!commands.empty()) {
    const std::size_t length = std::min(commands.find(' '), commands.size());
    if (command.starts_with(commands.substr(0, length))) return true;
    commands.remove_prefix(std::min(length + 1, commands.size()));
  }
  return false;
}

}  // namespace

ReplyStatus::ReplyStatus(std::string_view text) {
  size_ = static_cast<std::uint8_t>(std::min(text.size(), text_.size()));
  std::copy_n(text.begin(), size_, text_.begin());
}

StatusInfo explain(std::string_view command, const ReplyStatus& status) {
  if (command.starts_with('%')) command.remove_prefix(1);
  const std::string_view code = status.text();
  const auto* const row = std::find_if(std::begin(kRows), std::end(kRows), [&](const Row& r) {
    return code.size() == r.first.size() && r.first <= code && code <= r.last && applies(r.commands, command);
  });
  return row == std::end(kRows) ? StatusInfo{kUnknown, "status unknown to this driver"} : row->info;
}

Health health_of(std::string_view stat_text) {
  constexpr std::string_view kGood[] = {"Sensor works well.", "Stable 000 no error.", "sensor is working normally"};
  const bool good = std::any_of(std::begin(kGood), std::end(kGood),
                                [&](std::string_view text) { return stat_text.starts_with(text); });
  if (good) return Health::kWorking;
  constexpr std::string_view kBad[] = {"Trouble", "failed to synchronize", "detected multiple master sensor", "error"};
  const bool bad = std::any_of(std::begin(kBad), std::end(kBad),
                               [&](std::string_view text) { return stat_text.find(text) != stat_text.npos; });
  return bad ? Health::kTrouble : Health::kUnknown;
}

}  // namespace submapd::driver::scip
