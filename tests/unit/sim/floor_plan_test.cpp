// Floor plans: known files, damaged files, and tours planned through them.
#include "tools/sim/floor_plan.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <cmath>

#include "tools/sim/tour_planner.hpp"

namespace submapd::tools {
namespace {

using testing::HasSubstr;

TEST(WallCsv, ReadsWallsCommentsAndBlanks) {
  const auto walls = parse_wall_csv("# x1,y1,x2,y2\n1,2,3,4\r\n\n -1.5, 0 ,2e1,7\n0,0,1,1", "plan.csv");
  ASSERT_TRUE(walls) << walls.error().message();
  ASSERT_EQ(walls->size(), 3U);
  EXPECT_EQ((*walls)[0].b, Eigen::Vector2d(3.0, 4.0));
  EXPECT_EQ((*walls)[1].a, Eigen::Vector2d(-1.5, 0.0));
  EXPECT_EQ((*walls)[1].b, Eigen::Vector2d(20.0, 7.0));
}

TEST(WallCsv, RefusesDamageWithFileAndLine) {
  for (const char* damaged : {"1,2,3,4\n1,2,3\n", "1,2,3,4\n1,2,3,4,5\n", "1,2,3,4\n1,2,x,4\n", "1,2,3,4\n1,2,nan,4\n",
                              "1,2,3,4\n1,2,inf,4\n", "1,2,3,4\n1,2,1e300,4\n", "1,2,3,4\n1 2 3 4\n"}) {
    const auto walls = parse_wall_csv(damaged, "plan.csv");
    ASSERT_FALSE(walls) << damaged;
    EXPECT_EQ(walls.error().code(), StatusCode::kCorrupt);
    EXPECT_THAT(walls.error().message(), HasSubstr("plan.csv:2:"));
  }
  EXPECT_FALSE(parse_wall_csv("", "plan.csv"));
  EXPECT_FALSE(parse_wall_csv("# nothing\n", "plan.csv"));
}

TEST(Pgm, ReadsBothKinds) {
  using namespace std::string_literals;
  const auto text = parse_pgm("P2\n# made by hand\n3 2\n# levels\n5\n0 5 5\n0 0 4\n", "map.pgm", 0.1);
  ASSERT_TRUE(text) << text.error().message();
  const auto binary = parse_pgm("P5 3 2 255\n\x00\xff\xff\x00\x00\xcc"s, "map.pgm", 0.1);
  ASSERT_TRUE(binary) << binary.error().message();
  EXPECT_EQ(text->grey, binary->grey);
  EXPECT_EQ(text->width, 3);
  EXPECT_EQ(text->height, 2);
  // First row on top: (0, 0) is the lower left corner.
  EXPECT_TRUE(text->wall(0, 1));
  EXPECT_FALSE(text->free_at({0.05, 0.05}));
  EXPECT_TRUE(text->free_at({0.15, 0.15}));
  EXPECT_FALSE(text->free_at({0.25, 0.05})) << "unknown";
  EXPECT_FALSE(text->free_at({0.35, 0.15})) << "outside";
  EXPECT_FALSE(text->free_at({-0.05, 0.15})) << "outside";
}

TEST(Pgm, RefusesDamage) {
  using namespace std::string_literals;
  for (const std::string& damaged :
       {""s, "P6 1 1 255\n\x00"s, "P5"s, "P5 2"s, "P5 2 2 255\n\x00\x00\x00"s, "P5 0 2 255\n"s, "P5 -2 2 255\n\x00"s,
        "P5 2 2 65535\n\x00\x00\x00\x00"s, "P5 20000 20000 255\n\x00"s, "P5 99999999999 1 255\n\x00"s,
        "P2 2 1 255\n1 x   "s, "P2 2 1 255\n1 256 "s, "P5 1 1 100\n\xff"s, "P5 2 2 # never ends"s}) {
    const auto map = parse_pgm(damaged, "map.pgm", 0.05);
    ASSERT_FALSE(map) << damaged;
    EXPECT_EQ(map.error().code(), StatusCode::kCorrupt);
    EXPECT_THAT(map.error().message(), HasSubstr("map.pgm: "));
  }
  EXPECT_EQ(parse_pgm("P2 1 1 1\n1 ", "map.pgm", 0.0).error().code(), StatusCode::kInvalidArgument);
  EXPECT_EQ(parse_pgm("P2 1 1 1\n1 ", "map.pgm", NAN).error().code(), StatusCode::kInvalidArgument);
}

TEST(Pgm, AnyBytesGiveAMapOrAnError) {
  const bool holds = rc::check("parse_pgm and parse_wall_csv", [](const std::string& noise, bool binary, bool header) {
    const std::string bytes = (header ? (binary ? "P5 3 2 255\n" : "P2 3 2 255\n") : "") + noise;
    const auto map = parse_pgm(bytes, "noise", 0.05);
    if (map) {
      RC_ASSERT(map->grey.size() == static_cast<std::size_t>(map->width) * static_cast<std::size_t>(map->height));
    }
    const auto walls = parse_wall_csv(noise, "noise");
    if (walls) {
      RC_ASSERT(!walls->empty());
    }
  });
  EXPECT_TRUE(holds);
}

TEST(Outline, SurroundsCellsWithJoinedRuns) {
  GreyMap map;
  map.width = 4;
  map.height = 3;
  map.resolution_m = 0.5;
  map.grey = {255, 255, 255, 255, 255, 0, 0, 255, 255, 255, 255, 255};
  const std::vector<Segment> segments = outline(map, &GreyMap::wall);
  ASSERT_EQ(segments.size(), 4U) << "two cells side by side have four sides, not six or eight";
  const World world(segments);
  EXPECT_EQ(world.segments().size(), 4U);
  EXPECT_NEAR(world.cast({0.1, 0.75}, {1.0, 0.0}, 30.0)->range_m, 0.4, 1e-12);
  EXPECT_NEAR(world.cast({1.9, 0.75}, {-1.0, 0.0}, 30.0)->range_m, 0.4, 1e-12);
  EXPECT_NEAR(world.cast({1.0, 0.1}, {0.0, 1.0}, 30.0)->range_m, 0.4, 1e-12);
  EXPECT_NEAR(world.cast({1.0, 1.4}, {0.0, -1.0}, 30.0)->range_m, 0.4, 1e-12);
}

// Two rooms of 8 x 6 m joined by a door of 1.2 m, as walls.
std::vector<Segment> two_rooms() {
  return {{{0, 0}, {16, 0}}, {{16, 0}, {16, 6}}, {{16, 6}, {0, 6}},
          {{0, 6}, {0, 0}},  {{8, 0}, {8, 2.4}}, {{8, 3.6}, {8, 6}}};
}

TEST(TourPlanner, VisitsBothRoomsAndKeepsClear) {
  const World world(two_rooms());
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    TourOptions options;
    options.seed = seed;
    options.goal_spacing_m = 3.0;
    const Expected<Route> route = plan_tour({world, world, {}}, options);
    ASSERT_TRUE(route) << route.error().message();
    const Expected<Motion> motion = Motion::along(*route, {});
    ASSERT_TRUE(motion);
    EXPECT_GE(min_clearance(world, *motion, 1.0), 0.3);
    double low = 1e9;
    double high = -1e9;
    for (double time_s = 0.0; time_s < motion->duration_s(); time_s += 0.1) {
      low = std::min(low, motion->at(time_s).x);
      high = std::max(high, motion->at(time_s).x);
    }
    EXPECT_LT(low, 4.0);
    EXPECT_GT(high, 12.0);
  }
}

TEST(TourPlanner, SameSeedSameTour) {
  const World world(two_rooms());
  const auto tour = [&](std::uint64_t seed) {
    TourOptions options;
    options.seed = seed;
    options.goal_spacing_m = 3.0;
    return plan_tour({world, world, {}}, options)->waypoints;
  };
  EXPECT_EQ(tour(1), tour(1));
  EXPECT_NE(tour(1), tour(2));
}

TEST(TourPlanner, RefusesPlansWithoutRoom) {
  const World box({{{0, 0}, {0.5, 0}}, {{0.5, 0}, {0.5, 0.5}}, {{0.5, 0.5}, {0, 0.5}}, {{0, 0.5}, {0, 0}}});
  EXPECT_EQ(plan_tour({box, box, {}}, {}).error().code(), StatusCode::kInvalidArgument);
  const World open({{{0, 0}, {5, 0}}});
  EXPECT_FALSE(plan_tour({open, open, {}}, {}));
}

}  // namespace
}  // namespace submapd::tools
