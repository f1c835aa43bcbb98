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
      "{:<11} {:<10} {:<11} {:5.1f} Hz  {:9.0f} scans  {:.0f} dropped  {:.0f} bad  {:.0f} reconnects  {}\n", name,
      text_of(s, "serial"), flag(s, "present") ? text_of(s, "state") : "absent", number(s, "rate_hz"),
      number(s, "scans"), number(s, "dropped"), number(s, "bad_frames"), number(s, "reconnects"), text_of(s, "words"));
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
  out += fmt::format(
      "{:<11} {:.0f} scans, {:.0f} not mapped, {:.0f} missing, {:.0f} fitted nowhere; {:.0f} particles{}\n", "filter",
      number(mapper, "scans"), number(mapper, "skipped"), number(mapper, "missing"), number(mapper, "lost"),
      number(mapper, "particles"), flag(mapper, "degenerate") ? ", a direction is not observable" : "");
  out += fmt::format("{:<11} {:.0f} on the disk, {:.0f} in the graph, {:.0f} loops, {:.0f} pending\n", "sub-maps",
                     number(recorder, "last_submap") + 1, number(optimizer, "submaps"),
                     number(optimizer, "loops_confirmed"), number(optimizer, "loops_pending"));
  out += fmt::format("{:<11} {:.0f} raw scans, {:.0f} lost, {:.0f} MB left\n", "disk", number(recorder, "raw_scans"),
                     number(recorder, "raw_lost"), number(recorder, "disk_free_bytes") / kMB);
  out += fmt::format("{:<11} {}, {:.0f} poses, p99 {:.1f} ms, {:.0f} dropped\n", "LCM",
                     flag(publisher, "lcm") ? "sending" : "no network", number(publisher, "poses"),
                     number(publisher, "scan_ms_p99"), number(publisher, "dropped"));
  out += fmt::format("{:<11} {:.0f} MB of {:.0f} MB and 40 for code and stacks\n", "memory",
                     number(memory, "rss_bytes") / kMB, number(memory, "budget_bytes") / kMB);
  return out;
}

}  // namespace submapd::tools
