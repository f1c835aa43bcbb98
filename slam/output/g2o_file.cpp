#include "slam/output/g2o_file.hpp"

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <fstream>
#include <string>
#include <unordered_set>

#include "slam/output/internal/text_file.hpp"
#include "slam/output/internal/text_parser.hpp"

namespace submapd {
namespace {

using IdSet = std::unordered_set<std::uint64_t>;

bool finite(const Pose2& pose) {
  return std::isfinite(pose.x) && std::isfinite(pose.y) && std::isfinite(pose.yaw);
}

Status check_finite(const GraphExport& graph) {
  const auto bad = [](std::string_view what, std::uint64_t id) {
    return Status(StatusCode::kInvalidArgument, fmt::format("{} {} has a value that is not finite", what, id));
  };
  for (const GraphPose& pose : graph.poses) {
    if (!finite(pose.pose)) return bad("VERTEX_SE2", pose.id);
  }
  for (const GraphPoint& point : graph.points) {
    if (!point.point.allFinite()) return bad("VERTEX_XY", point.id);
  }
  for (const GraphPoseEdge& edge : graph.pose_edges) {
    if (!finite(edge.measurement) || !edge.information.allFinite()) return bad("EDGE_SE2 from", edge.from);
  }
  for (const GraphPointEdge& edge : graph.point_edges) {
    if (!edge.measurement.allFinite() || !edge.information.allFinite()) return bad("EDGE_SE2_XY from", edge.from);
  }
  return {};
}

bool parse(internal::TextParser& parser, GraphPose& pose) {
  return parser.next(pose.id) && parser.next(pose.pose.x) && parser.next(pose.pose.y) && parser.next(pose.pose.yaw) &&
         parser.at_line_end();
}

bool parse(internal::TextParser& parser, GraphPoint& point) {
  return parser.next(point.id) && parser.next(point.point.x()) && parser.next(point.point.y()) && parser.at_line_end();
}

// The upper triangle in row order, mirrored into the lower one.
template <typename Matrix>
bool parse_information(internal::TextParser& parser, Matrix& information) {
  for (Eigen::Index row = 0; row < information.rows(); ++row) {
    for (Eigen::Index column = row; column < information.cols(); ++column) {
      if (!parser.next(information(row, column))) return false;
      information(column, row) = information(row, column);
    }
  }
  return parser.at_line_end();
}

bool parse(internal::TextParser& parser, GraphPoseEdge& edge) {
  return parser.next(edge.from) && parser.next(edge.to) && parser.next(edge.measurement.x) &&
         parser.next(edge.measurement.y) && parser.next(edge.measurement.yaw) &&
         parse_information(parser, edge.information);
}

bool parse(internal::TextParser& parser, GraphPointEdge& edge) {
  return parser.next(edge.from) && parser.next(edge.to) && parser.next(edge.measurement.x()) &&
         parser.next(edge.measurement.y()) && parse_information(parser, edge.information);
}

// Parses the rest of the line as one more element of `list`.
template <typename List>
bool parse_into(internal::TextParser& parser, List& list) {
  return parse(parser, list.emplace_back());
}

bool parse_line(internal::TextParser& parser, std::string_view tag, GraphExport& graph) {
  if (tag == "VERTEX_SE2") return parse_into(parser, graph.poses);
  if (tag == "VERTEX_XY") return parse_into(parser, graph.points);
  if (tag == "EDGE_SE2") return parse_into(parser, graph.pose_edges);
  if (tag == "EDGE_SE2_XY") return parse_into(parser, graph.point_edges);
  return tag == "FIX" && parser.next(graph.fixed.emplace_back()) && parser.at_line_end();
}

Status check_references(const GraphExport& graph, std::string_view name) {
  const auto bad = [name](std::string_view what, std::uint64_t id) {
    return Status(StatusCode::kCorrupt, fmt::format("{}: {} {}", name, what, id));
  };
  IdSet poses;
  IdSet points;
  for (const GraphPose& pose : graph.poses) {
    if (!poses.insert(pose.id).second) return bad("two vertices have the id", pose.id);
  }
  for (const GraphPoint& point : graph.points) {
    if (poses.contains(point.id) || !points.insert(point.id).second) return bad("two vertices have the id", point.id);
  }
  for (const GraphPoseEdge& edge : graph.pose_edges) {
    if (!poses.contains(edge.from)) return bad("an EDGE_SE2 starts at the unknown pose", edge.from);
    if (!poses.contains(edge.to)) return bad("an EDGE_SE2 ends at the unknown pose", edge.to);
  }
  for (const GraphPointEdge& edge : graph.point_edges) {
    if (!poses.contains(edge.from)) return bad("an EDGE_SE2_XY starts at the unknown pose", edge.from);
    if (!points.contains(edge.to)) return bad("an EDGE_SE2_XY ends at the unknown point", edge.to);
  }
  for (const std::uint64_t id : graph.fixed) {
    if (!poses.contains(id) && !points.contains(id)) return bad("FIX names the unknown vertex", id);
  }
  return {};
}

}  // namespace

Status write_g2o(const std::filesystem::path& path, const GraphExport& graph) {
  if (Status status = check_finite(graph); !status.ok()) {
    return Status(status.code(), path.string() + ": " + status.message());
  }
  // The file keeps its first error and returns it at commit().
  internal::TextFile file(path);
  for (const GraphPose& v : graph.poses) {
    (void)file.print("VERTEX_SE2 {} {:.17g} {:.17g} {:.17g}\n", v.id, v.pose.x, v.pose.y, v.pose.yaw);
  }
  for (const GraphPoint& v : graph.points) {
    (void)file.print("VERTEX_XY {} {:.17g} {:.17g}\n", v.id, v.point.x(), v.point.y());
  }
  for (const std::uint64_t id : graph.fixed) (void)file.print("FIX {}\n", id);
  for (const GraphPoseEdge& e : graph.pose_edges) {
    (void)file.print("EDGE_SE2 {} {} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g}\n", e.from,
                     e.to, e.measurement.x, e.measurement.y, e.measurement.yaw, e.information(0, 0),
                     e.information(0, 1), e.information(0, 2), e.information(1, 1), e.information(1, 2),
                     e.information(2, 2));
  }
  for (const GraphPointEdge& e : graph.point_edges) {
    (void)file.print("EDGE_SE2_XY {} {} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g}\n", e.from, e.to, e.measurement.x(),
                     e.measurement.y(), e.information(0, 0), e.information(0, 1), e.information(1, 1));
  }
  return file.commit();
}

Expected<GraphExport> read_g2o(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return failure(StatusCode::kNotFound, path.string() + ": cannot open the graph");
  return read_g2o(in, path.string());
}

Expected<GraphExport> read_g2o(std::istream& in, std::string_view name) {
  internal::TextParser parser(in, name);
  GraphExport graph;
  while (parser.next_line()) {
    const std::string_view tag = parser.next_field();
    if (!parse_line(parser, tag, graph)) {
      return failure(parser.error(fmt::format("'{}' is no element we know, or its fields are wrong", tag)));
    }
  }
  if (!parser.status().ok()) return failure(parser.status());
  if (Status status = check_references(graph, name); !status.ok()) return failure(status);
  return graph;
}

}  // namespace submapd
