// Names of our LCM channels, by prefix, so that several carts can share one network.
#pragma once

#include <string>

namespace submapd {

struct Channels {
  // `prefix`: letters, digits and underscores, at most 40; LCM reads a channel to subscribe to as a regular expression.
  explicit Channels(const std::string& prefix = "CART")
      : scan_h(prefix + "_SCAN_H"),
        scan_v(prefix + "_SCAN_V"),
        intensity_h(prefix + "_INTENSITY_H"),
        intensity_v(prefix + "_INTENSITY_V"),
        pose(prefix + "_POSE"),
        submap(prefix + "_SUBMAP"),
        graph(prefix + "_GRAPH"),
        health(prefix + "_HEALTH"),
        reply(prefix + "_REPLY"),
        odometry(prefix + "_ODOMETRY"),
        trigger(prefix + "_TRIGGER"),
        command(prefix + "_COMMAND") {}

  std::string scan_h;
  std::string scan_v;
  std::string intensity_h;
  std::string intensity_v;
  std::string pose;
  std::string submap;
  std::string graph;
  std::string health;
  std::string reply;
  std::string odometry;  // this and the next two come in
  std::string trigger;
  std::string command;
};

}  // namespace submapd
