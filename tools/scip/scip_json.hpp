// SCIP events as JSON, one line each: what submapctl scip-decode prints.
//
// An event is an object with "ev": reply, ack, time, scan, stream_status, stale_scan or fault, and
//   echo, status, params      of a reply (params only of VV, PP, II)
//   t                         sensor's clock of a time or scan, ms (us behind '%' commands)
//   remaining                 scans still to come, of a stream's scan
//   ranges, intensities       raw values of each beam; with several echoes a beam: echoes, intensities as lists of
//   lists class, where, line        of a fault; line counts from 0 in its frame
#pragma once

#include <functional>
#include <string_view>

#include "driver/scip/event.hpp"

namespace submapd::tools {

class ScipJson final : public driver::scip::Listener {
 public:
  // Called with each line, without its line feed; the view lives until it returns.
  using Sink = std::function<void(std::string_view)>;
  explicit ScipJson(Sink sink) : sink_(std::move(sink)) {}

  void on_scan(const driver::scip::ScanData& scan) noexcept override;
  void on_stale_scan(const driver::scip::ScanData& scan) noexcept override;
  void on_stream_start(const driver::scip::Frame& frame) noexcept override;
  void on_stream_status(const driver::scip::Frame& frame) noexcept override;
  void on_time(const driver::scip::Frame& frame, std::uint64_t time) noexcept override;
  void on_reply(const driver::scip::Frame& frame,
                std::span<const driver::scip::Parameter> parameters) noexcept override;
  void on_fault(const driver::scip::Fault& fault) noexcept override;

 private:
  Sink sink_;
};

}  // namespace submapd::tools
