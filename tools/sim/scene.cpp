#include "tools/sim/scene.hpp"

#include <utility>

#include "tools/sim/floor_plan.hpp"
#include "tools/sim/office.hpp"
#include "tools/sim/tour_planner.hpp"

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

}  // namespace

Expected<Scene> make_scene(const SceneRequest& request) {
  const bool office = request.world == "office";
  Expected<FloorPlan> plan =
      office ? FloorPlan{office_world(), World({}), {}} : load_floor_plan(request.world, request.resolution_m);
  if (!plan) {
    return failure(plan.error());
  }
  TourOptions tour;
  tour.seed = request.seed;
  Expected<Route> route = !request.waypoints.empty() ? read_route(request.waypoints)
                          : office                   ? office_tour()
                                                     : plan_tour(*plan, tour);
  if (!route) {
    return failure(route.error());
  }
  return Scene{std::make_shared<const World>(std::move(plan->world)), std::move(*route)};
}

}  // namespace submapd::tools
