// Second moments of points in a plane about their mean, and the line through them in closed form: for the real-time
// path, where principal_axes (small_matrix.hpp) is more than is needed.
#pragma once

#include <cmath>

namespace submapd {

struct PlanarScatter {
  float xx = 0.0F;
  float xy = 0.0F;
  float yy = 0.0F;
};

// Eigenvalues: mean squares off and along the line. Rounding may leave `small` below zero.
struct ScatterValues {
  float small = 0.0F;
  float large = 0.0F;
};
[[nodiscard]] inline ScatterValues eigenvalues(const PlanarScatter& s) {
  const float mean = 0.5F * (s.xx + s.yy);
  const float half = 0.5F * (s.xx - s.yy);
  const float root = std::sqrt(half * half + s.xy * s.xy);
  return {mean - root, mean + root};
}

// The line's normal, of any length and sense: the eigenvector of `small`, from the row of the matrix that is longer.
struct ScatterNormal {
  float x = 0.0F;
  float y = 0.0F;
};
[[nodiscard]] inline ScatterNormal normal_of(const PlanarScatter& s, float small) {
  return s.xx > s.yy ? ScatterNormal{-s.xy, s.xx - small} : ScatterNormal{s.yy - small, -s.xy};
}

}  // namespace submapd
