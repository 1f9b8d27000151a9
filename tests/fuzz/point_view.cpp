// Points in a driver's layout with arbitrary values, as in a PointCloud2.
#include <cmath>
#include <limits>
#include <vector>

#include "bytes.h"
#include "fuzz.h"
#include "revisit/baselines/baselines.h"
#include "revisit/maps/map.h"
#include "revisit/registration/registration.h"
#include "small_rings.h"

namespace revisit::fuzz {
namespace {

using namespace revisit;

/// Coordinate [m] from one byte, so that most scans are realistic.
float coordinate(Bytes& bytes) {
  using Limits = std::numeric_limits<float>;
  constexpr float kOdd[] = {Limits::quiet_NaN(),
                            Limits::infinity(),
                            -Limits::infinity(),
                            Limits::max(),
                            Limits::lowest(),
                            Limits::denorm_min(),
                            Limits::min(),
                            1e19F,
                            -1e10F,
                            -0.0F};
  const auto code = bytes.number<uint8_t>();
  if (code == 255) return bytes.number<float>();
  if (code >= 240) return kOdd[code % std::size(kOdd)];
  return 0.3F * (static_cast<float>(code) - 120);
}

/// The memory ends with the last coordinate of the last point.
struct Given {
  PointsView view;
  std::vector<uint8_t> memory;
  bool fits = true;

  explicit Given(Bytes& bytes) {
    for (size_t* offset : {&view.x, &view.y, &view.z}) *offset = bytes.up_to(40);
    view.stride = bytes.up_to(48);
    const auto code = bytes.number<uint16_t>();
    view.count = code % 2000;
    view.is_double = code >= 32000;
    const size_t size = view.is_double ? sizeof(double) : sizeof(float);
    const size_t last = std::max({view.x, view.y, view.z}) + size;
    fits = view.stride >= last;
    if (!fits || view.count == 0) return;
    memory.resize((view.count - 1) * view.stride + last);
    for (size_t i = 0; i < view.count; ++i)
      for (const size_t offset : {view.x, view.y, view.z}) {
        const float value = coordinate(bytes);
        const double wide = 3.0 * value;  // may be too large for a float
        const void* from = view.is_double ? static_cast<const void*>(&wide) : &value;
        std::memcpy(&memory[i * view.stride + offset], from, size);
      }
    view.data = memory.data();
  }
};

/// No values in a scan may be reported as an error of the caller.
void recognize(const FeatureExtractor& feature, const PointsView& points) {
  Map map(feature, {.warmup = 2});
  const Description scan = map.describe(points);
  require(scan.described() == scan.error.empty(), "a scan is described, or it is said why not");
  ++(scan.described() ? successes : rejections);
  if (!scan.described()) return;
  for (int i = 0; i < 3; ++i) {
    map.add({{.feature = scan.feature}});
    const auto loop = map.query(scan);
    require(loop && std::isfinite(loop->similarity), "a scan that was added is found");
  }
}

void register_them(const PointsView& points) {
  PointCloud cloud;
  copy_points(points, cloud);
  const PreparedScan scan(cloud);
  const Registration found = register_scans(scan, scan, 0.1);
  require(found.T_place_query.matrix().allFinite() && found.information.allFinite(),
          "a registration is finite");
  require(found.inlier_ratio >= 0 && found.inlier_ratio <= 1, "inliers are a share");
}

}  // namespace
}  // namespace revisit::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  static const FeatureExtractor features[] = {fuzz::small_rings(),
                                              scan_context_features({.rings = 4, .sectors = 8})};
  fuzz::Bytes bytes(data, size);
  const fuzz::Given given(bytes);
  try {
    for (const FeatureExtractor& feature : features) fuzz::recognize(feature, given.view);
    fuzz::register_them(given.view);
  } catch (const UsageError&) {
    fuzz::require(!given.fits, "no UsageError for points that lie in their stride");
  }
  return 0;
}
