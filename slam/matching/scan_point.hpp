// One measured point of a scan, as the matcher wants it.
#pragma once

namespace submapd {

struct ScanPoint {
  float x = 0.0F;  // m, base frame at the scan's stamp
  float y = 0.0F;
  float view_x = 0.0F;  // unit, from the point towards the sensor, base frame
  float view_y = 0.0F;
  float normal_x = 0.0F;  // unit, of the surface there, towards the sensor; (0, 0) if the points around make no line
  float normal_y = 0.0F;
  float range_m = 0.0F;
  float weight = 1.0F;  // for all-beam sums: near, dense walls must not drown far ones
  bool alone = false;   // of something small in front of all that is seen beside it: it may walk
};

[[nodiscard]] inline float squared_distance(const ScanPoint& a, const ScanPoint& b) {
  const float dx = a.x - b.x;
  const float dy = a.y - b.y;
  return dx * dx + dy * dy;
}

}  // namespace submapd
