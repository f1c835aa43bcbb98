// The cell number of a coordinate, for loops that ask for it by the million.
#pragma once

namespace submapd {

// Floor of a number, +-1e6 for what lies beyond (NaN: below). Without SSE 4.1, which we do not ask for, std::floor is a
// call.
template <typename Real>
[[nodiscard]] inline int floor_to_int(Real x) {
  constexpr Real kLimit{1e6};
  const Real near = x > -kLimit ? (x < kLimit ? x : kLimit) : -kLimit;
  const int truncated = static_cast<int>(near);
  return truncated - (near < static_cast<Real>(truncated) ? 1 : 0);
}

}  // namespace submapd
