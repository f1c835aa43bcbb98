// One button: a key of an input device (a USB keypad, a foot switch) that saves the map.
//
// Reads Linux's input events (linux/input.h) of the configured device, which may come and go: look() tries again. The
// device is taken for ourselves alone, so that a foot switch types into no console. On the event loop's thread; never
// blocks.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "daemon/configuration.hpp"
#include "daemon/event_loop.hpp"

namespace submapd {

class MapButton {
 public:
  // `pressed` is called for each press of the key; repeats and releases are none. `loop` must outlive the object.
  MapButton(EventLoop& loop, const ButtonConfiguration& configuration, std::function<void()> pressed);
  MapButton(const MapButton&) = delete;
  MapButton& operator=(const MapButton&) = delete;
  ~MapButton();

  // Opens the device if it is not open. Call now and then.
  void look();
  void configure(const ButtonConfiguration& configuration);
  [[nodiscard]] const ButtonConfiguration& configuration() const { return configuration_; }
  // What is wrong with the device; empty if it works or none is configured.
  [[nodiscard]] const std::string& trouble() const { return trouble_; }

 private:
  void on_events();
  void shut();

  EventLoop& loop_;
  ButtonConfiguration configuration_;
  const std::function<void()> pressed_;
  int fd_ = -1;
  std::string trouble_;
};

}  // namespace submapd
