#include "ray_caster.h"
#include "scenery.h"
#include "testing.h"

namespace revisit::simulation {
namespace {

bool was_near(const Site& site, size_t frame) {
  for (size_t earlier = 0; earlier + 200 < frame; ++earlier)
    if ((site.T_site_floor[frame].translation() - site.T_site_floor[earlier].translation()).norm() <
        1)
      return true;
  return false;
}

/// On a golden spiral.
std::vector<Mesh::Vec> all_directions() {
  std::vector<Mesh::Vec> directions;
  for (int i = 0; i < 2000; ++i) {
    const double z = 1 - (2 * i + 1) / 2000.0, r = std::sqrt(1 - z * z), a = 2.39996 * i;
    directions.push_back(vec({r * std::cos(a), r * std::sin(a)}, z));
  }
  return directions;
}

TEST(Site, IsPassedTwiceAndHasNoGapsIndoorsNorThingsInTheWay) {
  const std::vector<Mesh::Vec> directions = all_directions();
  std::vector<Hit> hits(directions.size());
  for (const std::string name :
       {"office", "office-irregular", "office-changed", "office-carried", "floors", "stairwell",
        "garage", "mine", "greenhouse", "forest", "container-yard"})
    for (const uint64_t seed : {1, 2, 3}) {
      SCOPED_TRACE(str(name, " ", seed));
      const Site site = scenery_of(name).site(seed);
      const Scene scene(site.mesh);
      RayCaster rays(scene);
      const bool open = name == "forest" || name == "container-yard";
      size_t again = 0;
      for (size_t frame = 0; frame < site.T_site_floor.size(); frame += 50) {
        again += was_near(site, frame);
        rays.place(site.differing(frame));
        const Eigen::Vector3d sensor = site.T_site_floor[frame] * Eigen::Vector3d(0, 0, 0.7);
        rays.cast(sensor.cast<float>(), directions, 300, hits);
        for (const Hit& hit : hits) ASSERT_TRUE(hit.range > 0.15F || (open && hit.range < 0));
      }
      EXPECT_GT(again * 50, site.T_site_floor.size() / 4);
    }
}

TEST(Site, ChangesBetweenRoundsIfItsNameSaysSo) {
  const auto differs = [](const char* name) {
    const Site site = scenery_of(name).site(1);
    return site.differing(0).vertices != site.differing(site.round_of.size() - 1).vertices;
  };
  for (const char* const name : {"office-changed", "garage"}) EXPECT_TRUE(differs(name)) << name;
  for (const char* const name : {"office", "mine"}) EXPECT_FALSE(differs(name)) << name;
}

}  // namespace
}  // namespace revisit::simulation
