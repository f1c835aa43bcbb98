#include "tools/sim/worlds/worlds.hpp"

#include "tools/sim/office.hpp"

namespace submapd::tools {
namespace {

Site build_office(std::uint64_t /*seed*/) {
  Site site;
  site.walls = office_world().segments();
  site.route = office_tour();
  site.area_m2 = 40.0 * 25.0;
  site.effects = Effects{};  // figures of many commits are measured with the plain scanner
  for (const double y : {7.0, 17.0}) {
    site.walkways.push_back({{{3.0, y}, {37.0, y}}, 0.5});
  }
  for (const double x : {9.0, 21.0, 32.0}) {
    site.walkways.push_back({{{x, 7.0}, {x, 17.0}}, 0.5});
  }
  return site;
}

constexpr BuiltInWorld kWorlds[] = {
    {"office", build_office},
    {"mall", build_mall},
    {"street", build_street},
    {"car_park", build_car_park},
    {"ring", build_ring},
    {"twin_wings", build_twin_wings},
    {"identical_floors", build_identical_floors},
    {"corridor", build_corridor},
    {"corridor_ripple", build_corridor_ripple},
    {"corridor_braking", build_corridor_braking},
    {"ramp", build_ramp},
};

}  // namespace

std::span<const BuiltInWorld> built_in_worlds() {
  return kWorlds;
}

std::string world_names() {
  std::string names;
  for (const BuiltInWorld& world : kWorlds) {
    names.append(names.empty() ? "" : ", ").append(world.name);
  }
  return names;
}

}  // namespace submapd::tools
