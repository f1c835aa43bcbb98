// Pose graphs in the g2o text format: graph.g2o.
//
//   VERTEX_SE2 id x y yaw           EDGE_SE2 i j dx dy dyaw I11 I12 I13 I22 I23 I33
//   VERTEX_XY id x y                EDGE_SE2_XY i j x y I11 I12 I22
//   FIX id
//
// Information matrices as upper triangles in row order. 17 significant digits: every double comes back bit by bit.
#pragma once

#include <filesystem>
#include <iosfwd>
#include <string_view>

#include "slam/base/status.hpp"
#include "slam/graph/optimizer.hpp"

namespace submapd {

// Writes the file; it appears whole or not at all. Information must be symmetric: the lower triangle is not written.
// A value that is not finite is an error, as no reader takes it. Blocks on the disk.
[[nodiscard]] Status write_g2o(const std::filesystem::path& path, const GraphExport& graph);

// Reads what write_g2o() writes, elements in any order. Other tags, ids used twice, edges to unknown vertices, wrong
// numbers of fields and a cut-off last line are errors that name the line or the id.
[[nodiscard]] Expected<GraphExport> read_g2o(const std::filesystem::path& path);
// The same from a stream; `name` is for messages.
[[nodiscard]] Expected<GraphExport> read_g2o(std::istream& in, std::string_view name);

}  // namespace submapd
