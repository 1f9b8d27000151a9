#include "small_drive.h"

#include <cmath>
#include <sstream>
#include <string>

#include "testing.h"

namespace revisit::test {
namespace {

/// Room of 60 x 10 m with position-dependent walls, seen from (x, 0) [m].
std::string scan_at(double x, const Beams& beams) {
  std::string bytes;
  for (int i = 0; i < 720; ++i) {
    const double angle = i * 3.14159265358979 / 360, dx = std::cos(angle), dy = std::sin(angle);
    const double to_end = dx > 0 ? (40 - x) / dx : dx < 0 ? (-20 - x) / dx : 1e9;
    const double to_side = std::abs(dy) > 1e-9 ? 5 / std::abs(dy) : 1e9;
    double range = std::min(to_end, to_side);
    range -= 0.5 + 0.5 * std::sin(3 * (x + range * dx)) * std::cos(x + range * dx);
    for (int beam = 0; beam < beams.count; ++beam) {
      const double elevation = (beams.top - beams.step * beam) * 3.14159265358979 / 180;
      const float point[4] = {static_cast<float>(range * dx), static_cast<float>(range * dy),
                              static_cast<float>(range * std::tan(elevation)), 0.5F};
      bytes.append(reinterpret_cast<const char*>(point), sizeof point);
    }
  }
  return bytes;
}

}  // namespace

void write_small_drive(const std::filesystem::path& root, int n, const Beams& beams) {
  std::ostringstream poses, times;
  for (int i = 0; i < n; ++i) {
    const double along = 20.0 * (i % (n / 2)) / (n / 2);  // two passes
    std::string name = std::to_string(i);
    name.insert(0, 6 - name.size(), '0');
    write_file(root / "sequences/00/velodyne" / (name + ".bin"),
               scan_at(along + 0.1 * (i >= n / 2), beams));
    // Camera axes: x right, y down, z forward. The velodyne's x is the camera's z.
    poses << "1 0 0 0 0 1 0 0 0 0 1 " << along + 0.1 * (i >= n / 2) << "\n";
    times << 0.1 * i << "\n";
  }
  write_file(root / "poses/00.txt", poses.str());
  write_file(root / "sequences/00/times.txt", times.str());
  write_file(root / "sequences/00/calib.txt", "Tr: 0 -1 0 0 0 0 -1 0 1 0 0 0\n");
}

}  // namespace revisit::test
