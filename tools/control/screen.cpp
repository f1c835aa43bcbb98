#include <fmt/format.h>

#include "tools/control/control_client.hpp"

namespace submapd::tools {
namespace {

using nlohmann::json;

double number(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number() ? found->get<double>() : 0.0;
}

bool flag(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_boolean() && found->get<bool>();
}

json part(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_object() ? *found : json::object();
}

std::string scanner_line(const char* name, const json& s) {
  if (!flag(s, "configured")) return fmt::format("{:<11} not configured\n", name);
  return fmt::format(
      "{:<11} {:<10} {:<11} {:5.1f} Hz  {:.0f} scans  {:.0f} dropped  {:.0f} bad  {:.0f} reconnects  clock +-{:.2f} ms "
      " "
      "{}\n",
      name, text_of(s, "serial"), flag(s, "present") ? text_of(s, "state") : "absent", number(s, "rate_hz"),
      number(s, "scans"), number(s, "dropped"), number(s, "bad_frames"), number(s, "reconnects"),
      number(s, "clock_error_ms"), text_of(s, "words"));
}

std::string save_line(const json& save) {
  const std::string state = text_of(save, "state");
  if (state == "working") return fmt::format("{} at {:.0f} %", text_of(save, "name"), number(save, "percent"));
  if (state == "done") return fmt::format("{}, {:.0f} s ago", text_of(save, "path"), number(save, "ago_s"));
  if (state == "failed") return fmt::format("{} failed: {}", text_of(save, "name"), text_of(save, "message"));
  return "none yet";
}

std::string disk_left(const json& recorder) {
  const double minutes = number(recorder, "disk_minutes");
  return minutes > 0.0 ? fmt::format(", {:.0f} min of recording", minutes) : "";
}

}  // namespace

std::string screen_of(const json& health) {
  const json scanners = part(health, "scanners");
  const json mapper = part(health, "mapper");
  const json recorder = part(health, "recorder");
  const json publisher = part(health, "publisher");
  const json optimizer = part(health, "optimizer");
  const json memory = part(health, "memory");
  constexpr double kMB = 1024.0 * 1024.0;
  std::string out =
      fmt::format("{}  run {}  {}\n", text_of(health, "state"), text_of(health, "run"), text_of(health, "message"));
  out += scanner_line("horizontal", part(scanners, "horizontal"));
  out += scanner_line("vertical", part(scanners, "vertical"));
  const json inputs = part(health, "inputs");
  const json control = part(health, "control");
  out += fmt::format(
      "{:<11} {:.0f} scans, {:.0f} not mapped, {:.0f} missing, {:.0f} fitted nowhere; {:.0f} particles, N_eff "
      "{:.1f}{}\n",
      "filter", number(mapper, "scans"), number(mapper, "skipped"), number(mapper, "missing"), number(mapper, "lost"),
      number(mapper, "particles"), number(mapper, "n_eff"),
      flag(mapper, "degenerate") ? ", a direction is not observable" : "");
  out += fmt::format("{:<11} {:.0f} on the disk, {:.0f} optimised", "sub-maps", number(recorder, "last_submap") + 1,
                     number(optimizer, "submaps"));
  const double condensed = number(optimizer, "condensed") + number(optimizer, "frozen");
  if (condensed > 0.0) out += fmt::format(" ({:.0f} of them condensed)", condensed);
  out += fmt::format(", {:.0f} loops, {:.0f} pending\n", number(optimizer, "loops_confirmed"),
                     number(optimizer, "loops_pending"));
  out +=
      fmt::format("{:<11} version {:.0f}, {:.0f} solves, the longest {:.0f} ms\n", "graph",
                  number(optimizer, "graph_version"), number(optimizer, "solves"), number(optimizer, "solve_ms_max"));
  out += fmt::format("{:<11} {:.0f} raw scans, {:.0f} lost, {:.0f} MB left{}\n", "disk", number(recorder, "raw_scans"),
                     number(recorder, "raw_lost"), number(recorder, "disk_free_bytes") / kMB, disk_left(recorder));
  out += fmt::format("{:<11} {}\n", "last map", save_line(part(health, "save")));
  out += fmt::format(
      "{:<11} {}, {:.1f} poses/s, p99 {:.1f} ms; sent {:.0f} poses, {:.0f} scans and states, {:.0f} chunks, "
      "{:.0f} graphs; {:.0f} dropped\n",
      "LCM out", flag(publisher, "lcm") ? "sending" : "no network", number(publisher, "pose_hz"),
      number(publisher, "scan_ms_p99"), number(publisher, "poses"), number(publisher, "posted"),
      number(publisher, "chunks"), number(optimizer, "graphs"), number(publisher, "dropped"));
  out += fmt::format(
      "{:<11} {:.0f} chunks, {:.0f} sub-maps lost, {:.0f} reread; {:.0f} foreign, {:.0f} forged, {:.0f} bad; "
      "inputs {:.0f}, {:.0f} bad, {:.0f} dropped\n",
      "LCM in", number(optimizer, "chunks"), number(optimizer, "lost"), number(optimizer, "reread"),
      number(optimizer, "foreign"), number(optimizer, "forged"), number(optimizer, "bad"), number(inputs, "taken"),
      number(inputs, "bad"), number(inputs, "dropped"));
  out += fmt::format("{:<11} {:.0f} turned away, {:.0f} shut out; longest turn {:.0f} ms; {:.0f} hooks failed\n",
                     "clients", number(control, "turned_away"), number(control, "shut_out"),
                     number(control, "longest_turn_ms"), number(control, "hook_failed"));
  out += fmt::format("{:<11} {:.0f} MB of {:.0f} MB and 40 for code and stacks\n", "memory",
                     number(memory, "rss_bytes") / kMB, number(memory, "budget_bytes") / kMB);
  return out;
}

}  // namespace submapd::tools
