// A world by name or file, and the way of a cart through it: what the simulating programs start from.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "slam/base/status.hpp"
#include "tools/sim/crowd.hpp"
#include "tools/sim/effects.hpp"
#include "tools/sim/floor.hpp"
#include "tools/sim/motion.hpp"
#include "tools/sim/world.hpp"

namespace submapd::tools {

struct SceneRequest {
  std::string world;           // a built-in one, or a file of walls (.csv) or a grey map (.pgm, .pgm.gz)
  std::string waypoints;       // file, x,y in m a line; empty: a tour is planned
  double resolution_m = 0.05;  // a cell of a grey map
  std::uint64_t seed = 1;      // of a built-in world, or of the planned tour
};

struct Scene {
  std::shared_ptr<const World> world;
  Route route;
  std::vector<Walkway> walkways;       // none in a world from a file
  int people = 0;                      // unless asked otherwise
  double ripple = 0.0;                 // of the cart's speed, see MotionOptions
  Effects effects;                     // unless asked otherwise
  std::shared_ptr<const Floor> floor;  // nothing: it is level
  std::shared_ptr<const World> moved;  // the world after its furniture was moved; nothing if it has none
};

// Fails for an unknown world (the message names the known ones), a file that cannot be read, or a plan without way.
[[nodiscard]] Expected<Scene> make_scene(const SceneRequest& request);

}  // namespace submapd::tools
