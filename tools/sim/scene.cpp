#include "tools/sim/scene.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "tools/sim/floor_plan.hpp"
#include "tools/sim/tour_planner.hpp"
#include "tools/sim/worlds/worlds.hpp"

namespace submapd::tools {
namespace {

Expected<Route> read_route(const std::string& path) {
  const Expected<std::string> text = read_text_file(path);
  if (!text) {
    return failure(text.error());
  }
  auto waypoints = parse_waypoints(*text, path);
  if (!waypoints) {
    return failure(waypoints.error());
  }
  constexpr double kClosed_m = 0.5;
  Route route;
  route.closed = waypoints->size() > 2 && (waypoints->front() - waypoints->back()).norm() < kClosed_m;
  route.waypoints = std::move(*waypoints);
  return route;
}

Expected<Scene> scene_of_file(const SceneRequest& request) {
  Expected<FloorPlan> plan = load_floor_plan(request.world, request.resolution_m);
  if (!plan) {
    return failure(plan.error());
  }
  TourOptions tour;
  tour.seed = request.seed;
  Expected<Route> route = request.waypoints.empty() ? plan_tour(*plan, tour) : read_route(request.waypoints);
  if (!route) {
    return failure(route.error());
  }
  Scene scene;
  scene.world = std::make_shared<const World>(std::move(plan->world));
  scene.route = std::move(*route);
  return scene;
}

}  // namespace

Expected<Scene> make_scene(const SceneRequest& request) {
  const auto worlds = built_in_worlds();
  const auto known = std::find_if(worlds.begin(), worlds.end(),
                                  [&](const BuiltInWorld& world) { return world.name == request.world; });
  if (known == worlds.end()) {
    if (request.world.find_first_of("./") != std::string::npos) {
      return scene_of_file(request);
    }
    return failure(StatusCode::kInvalidArgument,
                   fmt::format("{}: no world of that name; there are {}, and files .csv, .pgm, .pgm.gz", request.world,
                               world_names()));
  }
  Site site = known->build(request.seed);
  Scene scene;
  if (!site.furniture.empty()) {
    scene.moved = std::make_shared<const World>(move_furniture(site.walls, site.furniture, request.seed));
  }
  scene.world = std::make_shared<const World>(std::move(site.walls));
  scene.route = std::move(site.route);
  scene.walkways = std::move(site.walkways);
  scene.people = site.people;
  scene.ripple = site.ripple;
  scene.effects = site.effects;
  scene.floor = std::move(site.floor);
  if (!request.waypoints.empty()) {
    Expected<Route> route = read_route(request.waypoints);
    if (!route) {
      return failure(route.error());
    }
    scene.route = std::move(*route);
  }
  return scene;
}

}  // namespace submapd::tools
