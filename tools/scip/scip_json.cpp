#include "tools/scip/scip_json.hpp"

#include <nlohmann/json.hpp>
#include <string>

namespace submapd::tools {
namespace {

using driver::scip::Command;
using driver::scip::CommandKind;
using driver::scip::Frame;
using Json = nlohmann::ordered_json;

// Values of all echoes as one list a beam.
Json by_beam(std::span<const std::uint32_t> values, std::span<const std::uint8_t> echo_counts) {
  Json beams = Json::array();
  std::size_t at = 0;
  for (const std::uint8_t count : echo_counts) {
    const auto beam = values.subspan(at, count);
    beams.push_back(Json(std::vector<std::uint32_t>(beam.begin(), beam.end())));
    at += count;
  }
  return beams;
}

Json values(std::span<const std::uint32_t> list) {
  return std::vector<std::uint32_t>(list.begin(), list.end());
}

Json event(const char* kind, const Frame& frame) {
  return {{"ev", kind}, {"echo", std::string(frame.echo)}};
}

}  // namespace

void ScipJson::on_scan(const driver::scip::ScanData& scan) noexcept {
  Json json = event("scan", scan.frame);
  json["t"] = scan.time;
  if (scan.request.streams()) json["remaining"] = scan.request.number;
  if (scan.request.multi_echo()) {
    json["echoes"] = by_beam(scan.ranges_mm, scan.echo_counts);
    if (scan.request.intensities()) json["intensities"] = by_beam(scan.intensities, scan.echo_counts);
  } else {
    json["ranges"] = values(scan.ranges_mm);
    if (scan.request.intensities()) json["intensities"] = values(scan.intensities);
  }
  sink_(json.dump());
}

void ScipJson::on_stale_scan(const driver::scip::ScanData& scan) noexcept {
  Json json = event("stale_scan", scan.frame);
  json["t"] = scan.time;
  sink_(json.dump());
}

void ScipJson::on_stream_start(const Frame& frame) noexcept {
  sink_(event("ack", frame).dump());
}

void ScipJson::on_stream_status(const Frame& frame) noexcept {
  Json json = event("stream_status", frame);
  json["status"] = std::string(frame.status.text());
  sink_(json.dump());
}

void ScipJson::on_time(const Frame& frame, std::uint64_t time) noexcept {
  Json json = event("time", frame);
  json["t"] = time;
  sink_(json.dump());
}

void ScipJson::on_reply(const Frame& frame, std::span<const driver::scip::Parameter> parameters) noexcept {
  Json json = event("reply", frame);
  json["status"] = std::string(frame.status.text());
  const std::optional<Command> command = Command::parse(frame.echo);
  if (command && command->kind() == CommandKind::kParameters && frame.status == "00") {
    Json& params = json["params"] = Json::object();
    for (const auto& [key, value] : parameters) params[std::string(key)] = std::string(value);
  }
  sink_(json.dump());
}

void ScipJson::on_fault(const driver::scip::Fault& fault) noexcept {
  const Json json = {{"ev", "fault"},
                     {"class", std::string(name(fault.fault))},
                     {"where", std::string(name(fault.place))},
                     {"line", fault.line}};
  sink_(json.dump());
}

}  // namespace submapd::tools
