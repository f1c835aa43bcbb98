// What makes a simulated run like a real one: switches that a world has by default, and that can be asked for by name.
#pragma once

#include <string>

#include "slam/base/status.hpp"
#include "tools/sim/motion.hpp"
#include "tools/sim/simulator.hpp"

namespace submapd::tools {

struct Effects {
  bool mixed = false;  // mixed pixels: at edges a beam falls on two surfaces and answers between them
  bool bias = false;   // ranges off by up to 20 mm, by range and incidence
  bool clock = false;  // the scanner's clock runs wrongly by up to 100 ppm and tells milliseconds only
  bool lost = false;   // one scan of 200 is lost, and now and then half a second of them
  bool jerky = false;  // the cart is pushed in jerks, stops every 20 m or so, and looks round on the spot
  bool moved = false;  // from half of the run on, some furniture stands elsewhere or is gone
  friend bool operator==(const Effects&, const Effects&) = default;
};

// Of the scanner alone: what every real one has.
inline constexpr Effects kScannerEffects{.mixed = true, .bias = true, .clock = true, .lost = true};

// "mixed,bias", in any order; "all"; "none". The message of a failure names the known ones.
[[nodiscard]] Expected<Effects> parse_effects(const std::string& list);

void apply(const Effects& effects, MotionOptions& motion);
void apply(const Effects& effects, SensorOptions& sensor);

}  // namespace submapd::tools
