#include "slam/output/g2o_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <bit>
#include <limits>
#include <sstream>

#include "tests/unit/output/scratch_folder.hpp"

namespace submapd {
namespace {

using testing::HasSubstr;

Expected<GraphExport> parse(const std::string& text) {
  std::istringstream in(text);
  return read_g2o(in, "test.g2o");
}

// Any finite double, all exponents alike.
rc::Gen<double> finite_double() {
  return rc::gen::map(rc::gen::suchThat(rc::gen::arbitrary<std::uint64_t>(),
                                        [](std::uint64_t bits) { return std::isfinite(std::bit_cast<double>(bits)); }),
                      [](std::uint64_t bits) { return std::bit_cast<double>(bits); });
}

Pose2 any_pose() {
  return {*finite_double(), *finite_double(), *finite_double()};
}

template <typename Matrix>
Matrix any_symmetric() {
  Matrix m;
  for (Eigen::Index row = 0; row < m.rows(); ++row) {
    for (Eigen::Index column = row; column < m.cols(); ++column) m(row, column) = m(column, row) = *finite_double();
  }
  return m;
}

// Poses 0 .. p - 1, points 10^12 .., random edges among them.
GraphExport any_graph() {
  constexpr std::uint64_t kFirstPoint = 1'000'000'000'000;
  const auto poses = *rc::gen::inRange<std::uint64_t>(1, 6);
  const auto points = *rc::gen::inRange<std::uint64_t>(1, 4);
  GraphExport graph;
  for (std::uint64_t id = 0; id < poses; ++id) graph.poses.push_back({id, any_pose()});
  for (std::uint64_t id = 0; id < points; ++id) {
    graph.points.push_back({kFirstPoint + id, {*finite_double(), *finite_double()}});
  }
  const auto edges = *rc::gen::inRange(0, 6);
  for (int i = 0; i < edges; ++i) {
    const auto from = *rc::gen::inRange<std::uint64_t>(0, poses);
    graph.pose_edges.push_back(
        {from, *rc::gen::inRange<std::uint64_t>(0, poses), any_pose(), any_symmetric<Eigen::Matrix3d>()});
    graph.point_edges.push_back({from,
                                 kFirstPoint + *rc::gen::inRange<std::uint64_t>(0, points),
                                 {*finite_double(), *finite_double()},
                                 any_symmetric<Eigen::Matrix2d>()});
  }
  graph.fixed.push_back(*rc::gen::inRange<std::uint64_t>(0, poses));
  return graph;
}

RC_GTEST_PROP(G2oFileTest, EveryBitComesBack, ()) {
  const GraphExport graph = any_graph();
  const ScratchFolder folder;
  RC_ASSERT(write_g2o(folder.path() / "a.g2o", graph).ok());
  const auto read = read_g2o(folder.path() / "a.g2o");
  RC_ASSERT(read.has_value());
  RC_ASSERT(read->fixed == graph.fixed);
  RC_ASSERT(read->poses.size() == graph.poses.size());
  RC_ASSERT(read->points.size() == graph.points.size());
  RC_ASSERT(read->pose_edges.size() == graph.pose_edges.size());
  RC_ASSERT(read->point_edges.size() == graph.point_edges.size());
  for (std::size_t i = 0; i < graph.poses.size(); ++i) {
    RC_ASSERT(read->poses[i].id == graph.poses[i].id);
    RC_ASSERT(read->poses[i].pose == graph.poses[i].pose);
  }
  for (std::size_t i = 0; i < graph.points.size(); ++i) {
    RC_ASSERT(read->points[i].id == graph.points[i].id);
    RC_ASSERT(read->points[i].point == graph.points[i].point);
  }
  for (std::size_t i = 0; i < graph.pose_edges.size(); ++i) {
    RC_ASSERT(read->pose_edges[i].from == graph.pose_edges[i].from);
    RC_ASSERT(read->pose_edges[i].to == graph.pose_edges[i].to);
    RC_ASSERT(read->pose_edges[i].measurement == graph.pose_edges[i].measurement);
    RC_ASSERT(read->pose_edges[i].information == graph.pose_edges[i].information);
  }
  for (std::size_t i = 0; i < graph.point_edges.size(); ++i) {
    RC_ASSERT(read->point_edges[i].from == graph.point_edges[i].from);
    RC_ASSERT(read->point_edges[i].to == graph.point_edges[i].to);
    RC_ASSERT(read->point_edges[i].measurement == graph.point_edges[i].measurement);
    RC_ASSERT(read->point_edges[i].information == graph.point_edges[i].information);
  }
}

GraphExport small_graph() {
  GraphExport graph;
  graph.poses = {{0, {0.0, 0.0, 0.0}}, {1, {1.5, 0.25, -0.5}}};
  graph.points = {{2, {3.0, 4.0}}};
  graph.fixed = {0};
  Eigen::Matrix3d information;
  information << 1, 2, 3, 2, 4, 5, 3, 5, 6;
  graph.pose_edges = {{0, 1, {1.5, 0.25, -0.5}, information}};
  graph.point_edges = {{1, 2, {2.0, 1.0}, (Eigen::Matrix2d() << 7, 8, 8, 9).finished()}};
  return graph;
}

constexpr const char* kSmallText =
    "VERTEX_SE2 0 0 0 0\n"
    "VERTEX_SE2 1 1.5 0.25 -0.5\n"
    "VERTEX_XY 2 3 4\n"
    "FIX 0\n"
    "EDGE_SE2 0 1 1.5 0.25 -0.5 1 2 3 4 5 6\n"
    "EDGE_SE2_XY 1 2 2 1 7 8 9\n";

TEST(G2oFileTest, WritesTheDocumentedForm) {
  const ScratchFolder folder;
  ASSERT_TRUE(write_g2o(folder.path() / "a.g2o", small_graph()).ok());
  EXPECT_EQ(read_text(folder.path() / "a.g2o"), kSmallText);
}

TEST(G2oFileTest, WriteErrorsNameThePathAndLeaveNothing) {
  const ScratchFolder folder;
  const std::filesystem::path missing = folder.path() / "missing" / "a.g2o";
  EXPECT_EQ(write_g2o(missing, small_graph()).code(), StatusCode::kIo);
  EXPECT_THAT(write_g2o(missing, small_graph()).message(), HasSubstr(missing.string()));

  GraphExport graph = small_graph();
  graph.pose_edges[0].information(1, 2) = std::numeric_limits<double>::infinity();
  const Status status = write_g2o(folder.path() / "a.g2o", graph);
  EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
  EXPECT_THAT(status.message(), HasSubstr("a.g2o"));
  EXPECT_EQ(folder.entries(), 0U);
}

TEST(G2oFileTest, EveryCutOfAFileIsAnErrorUnlessItFallsBetweenLines) {
  const std::string whole = kSmallText;
  for (std::size_t length = 1; length < whole.size(); ++length) {
    if (whole[length - 1] == '\n') continue;
    const auto read = parse(whole.substr(0, length));
    ASSERT_FALSE(read.has_value()) << "cut to " << length << " bytes";
    EXPECT_EQ(read.error().code(), StatusCode::kCorrupt);
  }
}

TEST(G2oFileTest, DamageIsAnErrorThatSaysWhere) {
  const std::string vertices = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 0 0 0\nVERTEX_XY 2 0 0\n";
  ASSERT_TRUE(parse(vertices).has_value());
  for (const std::string line :
       {"VERTEX_SE3 3 0 0 0", "VERTEX_SE2 3 0 0", "VERTEX_SE2 3 0 0 0 0", "VERTEX_SE2 -3 0 0 0", "VERTEX_XY 3 0 x",
        "EDGE_SE2 0 1 0 0 nan 1 0 0 1 0 1", "EDGE_SE2 0 1 0 0 0 1 0 0 1 0", "EDGE_SE2_XY 0 2 0 0 1 0 1 1",
        "EDGE_SE2_XY 0 2 0 0 1 inf 1", "FIX", "FIX 0 1", "FIX 0x", "VERTEX_SE2 99999999999999999999 0 0 0"}) {
    const auto read = parse(vertices + line + "\n");
    ASSERT_FALSE(read.has_value()) << line;
    EXPECT_THAT(read.error().message(), HasSubstr("test.g2o:4: ")) << line;
  }
}

TEST(G2oFileTest, ReferencesAreChecked) {
  const std::string vertices = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 0 0 0\nVERTEX_XY 2 0 0\n";
  for (const std::string line :
       {"VERTEX_SE2 1 0 0 0", "VERTEX_XY 1 0 0", "VERTEX_XY 2 0 0", "EDGE_SE2 7 1 0 0 0 1 0 0 1 0 1",
        "EDGE_SE2 0 2 0 0 0 1 0 0 1 0 1", "EDGE_SE2_XY 7 2 0 0 1 0 1", "EDGE_SE2_XY 0 1 0 0 1 0 1", "FIX 7"}) {
    const auto read = parse(vertices + line + "\n");
    ASSERT_FALSE(read.has_value()) << line;
    EXPECT_EQ(read.error().code(), StatusCode::kCorrupt);
    EXPECT_THAT(read.error().message(), HasSubstr("test.g2o: ")) << line;
  }
  EXPECT_TRUE(parse("EDGE_SE2 0 1 0 0 0 1 0 0 1 0 1\n" + vertices).has_value()) << "any order will do";
  EXPECT_EQ(read_g2o(std::filesystem::path("no/such/file.g2o")).error().code(), StatusCode::kNotFound);
}

}  // namespace
}  // namespace submapd
