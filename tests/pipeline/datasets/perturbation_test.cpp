#include "revisit/datasets/perturbation.h"

#include "testing.h"

namespace revisit {
namespace {

/// Returns a room around the sensor, 1.7 m above its floor, with `beams` of elevation [rad] at
/// `azimuths` angles; intensities number the returns.
PointCloud hall(const std::vector<double>& beams, int azimuths, double half_width = 20) {
  PointCloud cloud;
  for (const double elevation : beams)
    for (int k = 0; k < azimuths; ++k) {
      const double azimuth = test::kPi - (k + 0.5) * test::kTurn / azimuths;
      const double x = std::cos(azimuth), y = std::sin(azimuth), z = std::tan(elevation);
      double far = half_width / std::max(std::abs(x), std::abs(y));
      if (z < 0) far = std::min(far, -1.7 / z);
      cloud.points.push_back({static_cast<float>(far * x), static_cast<float>(far * y),
                              static_cast<float>(far * z),
                              static_cast<float>(cloud.points.size())});
    }
  return cloud;
}

std::vector<double> evenly(int count, double top, double bottom) {
  std::vector<double> beams;
  for (int i = 0; i < count; ++i)
    beams.push_back((top + (bottom - top) * i / (count - 1)) * kDegree);
  return beams;
}

PointCloud perturbed(PointCloud cloud, const std::string& text, uint64_t seed = 1) {
  perturb(cloud, parse_perturbation(text), seed);
  return cloud;
}

bool same_points(const PointCloud& a, const PointCloud& b) {
  return a.points.size() == b.points.size() &&
         std::memcmp(a.points.data(), b.points.data(), a.points.size() * sizeof(Point)) == 0;
}

size_t number_of(const Point& p) {
  return static_cast<size_t>(p.intensity);
}
double range_of(const Point& p) {
  return std::hypot(double{p.x}, double{p.y}, double{p.z});
}
double azimuth_of(const Point& p) {
  return std::atan2(double{p.y}, double{p.x}) / kDegree;
}

void expect_point(const Point& p, double x, double y, double z) {
  EXPECT_NEAR(p.x, x, 1e-5);
  EXPECT_NEAR(p.y, y, 1e-5);
  EXPECT_NEAR(p.z, z, 1e-5);
}

/// Returns the moved points; they must have moved towards the sensor along their rays.
std::vector<Point> nearer(const PointCloud& before, const PointCloud& after) {
  std::vector<Point> moved;
  EXPECT_EQ(after.points.size(), before.points.size());
  for (const Point& p : after.points) {
    const Point& was = before.points[number_of(p)];
    if (std::memcmp(&p, &was, sizeof p) == 0) continue;
    const double share = range_of(p) / range_of(was);
    EXPECT_LT(share, 1);
    expect_point(p, share * was.x, share * was.y, share * was.z);
    moved.push_back(p);
  }
  return moved;
}

TEST(Perturbation, TextIsReadBack) {
  for (const char* text :
       {"none", "turn", "turn=-90", "pitch=5+range=30", "roll=2.5", "height=-0.5", "keep=0.2",
        "sector=60+sector=50", "beams=2", "noise=0.2", "rain=0.3+truck"})
    EXPECT_EQ(text_of(parse_perturbation(text)), text);
}

TEST(Perturbation, WrongTextsAreRefused) {
  for (const auto& [text, message] : std::map<std::string, std::string>{
           {"pich=5", "perturbation 'pich=5': unknown step 'pich' (did you mean 'pitch'?)"},
           {"pitch", "perturbation 'pitch': pitch takes -90 to 90 degrees, found 'pitch'"},
           {"range=30+pitch=5x", "pitch takes -90 to 90 degrees, found 'pitch=5x'"},
           {"roll=91", "found 'roll=91'"},
           {"keep=0", "keep takes a fraction of the points above 0, at most 1, found 'keep=0'"},
           {"keep=1.5", "found 'keep=1.5'"},
           {"beams=2.5", "beams takes a whole number from 2 to 64, found 'beams=2.5'"},
           {"beams=1", "found 'beams=1'"},
           {"sector=360", "found 'sector=360'"},
           {"noise=nan", "found 'noise=nan'"},
           {"range=inf", "found 'range=inf'"},
           {"rain=", "found 'rain='"},
           {"truck=1", "truck takes no amount, found 'truck=1'"},
           {"height", "found 'height'"},
           {"none+truck", "unknown step 'none'"},
           {"truck+", "unknown step ''"},
           {"", "unknown step ''"}})
    expect_error<UsageError>([&] { parse_perturbation(text); }, {message});
}

TEST(Perturbation, AScanAsItIsKeepsEveryBit) {
  PointCloud cloud{{{1, 2, 3, 4}, {0, 0, 0, 0}, {std::nanf(""), 1, 1, 1}}};
  EXPECT_TRUE(same_points(perturbed(cloud, "none"), cloud));
  EXPECT_EQ(perturbed(cloud, "height=1").points.size(), 1u) << "no return becomes a point";
}

TEST(Perturbation, TurnsAndShiftsByHand) {
  const double s = std::sin(5 * kDegree), c = std::cos(5 * kDegree);
  const PointCloud axes{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}};
  const PointCloud turned = perturbed(axes, "turn=90");
  expect_point(turned.points[0], 0, 1, 0);
  expect_point(turned.points[1], -1, 0, 0);
  const PointCloud rolled = perturbed(axes, "roll=5");
  expect_point(rolled.points[0], 1, 0, 0);
  expect_point(rolled.points[1], 0, c, s);
  expect_point(rolled.points[2], 0, -s, c);
  const PointCloud pitched = perturbed(axes, "pitch=5");
  expect_point(pitched.points[0], c, 0, -s);
  expect_point(pitched.points[1], 0, 1, 0);
  expect_point(pitched.points[2], s, 0, c);
  expect_point(perturbed(axes, "height=1").points[0], 1, 0, 1);
  expect_point(perturbed(axes, "height=-1").points[0], 1, 0, -1);
  expect_point(perturbed(axes, "turn=90+height=1+pitch=90").points[0], 1, 1, 0);
}

TEST(Perturbation, AnyYawIsAnyAndOne) {
  const PointCloud cloud = hall(evenly(8, 2, -20), 90);
  double least = 180, most = -180;
  for (uint64_t seed = 0; seed < 40; ++seed) {
    const PointCloud turned = perturbed(cloud, "turn", seed);
    const double yaw = azimuth_of(turned.points[0]) - azimuth_of(cloud.points[0]);
    for (size_t i = 0; i < cloud.points.size(); ++i) {
      const Point &was = cloud.points[i], &p = turned.points[i];
      ASSERT_NEAR(std::remainder(azimuth_of(p) - azimuth_of(was) - yaw, 360), 0, 1e-3);
      ASSERT_EQ(p.z, was.z);
    }
    least = std::min(least, std::remainder(yaw, 360));
    most = std::max(most, std::remainder(yaw, 360));
  }
  EXPECT_LT(least, -120);
  EXPECT_GT(most, 120);
}

TEST(Perturbation, PointsStayAtRandom) {
  const PointCloud cloud = hall(evenly(20, 2, -20), 500);
  const PointCloud kept = perturbed(cloud, "keep=0.2");
  EXPECT_NEAR(static_cast<double>(kept.points.size()), 2000, 4 * std::sqrt(10000 * 0.2 * 0.8));
  EXPECT_TRUE(std::ranges::is_sorted(kept.points, {}, number_of));
  for (const Point& p : kept.points)
    ASSERT_EQ(std::memcmp(&p, &cloud.points[number_of(p)], sizeof p), 0);
}

TEST(Perturbation, ASectorIsHiddenWhole) {
  const PointCloud cloud = hall(evenly(4, 2, -20), 3600);
  for (const double width : {60, 180, 300}) {
    const PointCloud seen = perturbed(cloud, str("sector=", width), static_cast<uint64_t>(width));
    std::vector<double> azimuths;
    for (const Point& p : seen.points) azimuths.push_back(azimuth_of(p));
    EXPECT_NEAR(static_cast<double>(seen.points.size()), 4 * (3600 - 10 * width), 4);
    std::ranges::sort(azimuths);
    double gap = azimuths.front() + 360 - azimuths.back();
    for (size_t i = 1; i < azimuths.size(); ++i) gap = std::max(gap, azimuths[i] - azimuths[i - 1]);
    EXPECT_NEAR(gap, width, 0.2);
  }
  // Two sectors have independent azimuths: the second must hide something in some scans.
  std::vector<size_t> sizes;
  for (uint64_t seed = 0; seed < 20; ++seed)
    sizes.push_back(perturbed(cloud, "sector=60+sector=60", seed).points.size());
  const auto [least, most] = std::ranges::minmax(sizes);
  EXPECT_NEAR(static_cast<double>(least), 4 * 2400, 8);
  EXPECT_LE(most, 4u * 3000);
}

TEST(Perturbation, EveryNthBeamStaysWhole) {
  std::vector<double> hdl64 = evenly(32, 2, 2 - 31 / 3.0);
  for (const double elevation : evenly(32, 2 - 31 / 3.0 - 0.5, -24.8)) hdl64.push_back(elevation);
  const std::map<std::string, std::vector<double>> sensors = {{"hdl64", hdl64},
                                                              {"vlp16", evenly(16, 15, -15)},
                                                              {"os1", evenly(64, 22.5, -22.5)},
                                                              {"unknown", evenly(24, 7, -30)}};
  for (const auto& [name, beams] : sensors)
    for (const bool shuffled : {false, true})
      for (const int n : {2, 3, 4}) {
        constexpr int kAzimuths = 400;
        PointCloud cloud = hall(beams, kAzimuths);
        if (shuffled) std::ranges::shuffle(cloud.points, std::mt19937(1));
        const PointCloud kept = perturbed(cloud, str("beams=", n));
        std::map<size_t, int> returns;  // by beam, highest first
        for (const Point& p : kept.points) ++returns[number_of(p) / kAzimuths];
        EXPECT_EQ(returns.size(),
                  (beams.size() + static_cast<size_t>(n) - 1) / static_cast<size_t>(n))
            << name << " " << n;
        for (const auto& [beam, count] : returns) {
          EXPECT_EQ((beams.size() - 1 - beam) % static_cast<size_t>(n), 0u) << name << " " << n;
          EXPECT_EQ(count, kAzimuths) << name << " " << n;
        }
      }
}

TEST(Perturbation, BeamsAreTheSensorsAlsoWhenItIsTilted) {
  const PointCloud cloud = hall(evenly(24, 7, -30), 300);
  EXPECT_TRUE(
      same_points(perturbed(cloud, "pitch=5+beams=2"), perturbed(cloud, "beams=2+pitch=5")));
}

TEST(Perturbation, WithoutBeamsElevationsAreTheRows) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> elevation(-7, 52), azimuth(-180, 180);
  PointCloud cloud;
  for (int i = 0; i < 20000; ++i) {
    const double e = elevation(random) * kDegree, a = azimuth(random) * kDegree;
    cloud.points.push_back({static_cast<float>(10 * std::cos(e) * std::cos(a)),
                            static_cast<float>(10 * std::cos(e) * std::sin(a)),
                            static_cast<float>(10 * std::sin(e)), static_cast<float>(i)});
  }
  EXPECT_NEAR(static_cast<double>(perturbed(cloud, "beams=2").points.size()), 10000, 400);
  EXPECT_NEAR(static_cast<double>(perturbed(cloud, "beams=4").points.size()), 5000, 400);
}

TEST(Perturbation, NoiseIsNormal) {
  PointCloud cloud;
  for (int i = 0; i < 20000; ++i) cloud.points.push_back({10, 20, 30, 0});
  const PointCloud noisy = perturbed(cloud, "noise=0.5");
  for (float Point::*axis : {&Point::x, &Point::y, &Point::z}) {
    const double truth = cloud.points[0].*axis;
    double sum = 0, squares = 0;
    int within_one = 0, beyond_two = 0;
    for (const Point& p : noisy.points) {
      const double d = (p.*axis - truth) / 0.5;
      sum += d;
      squares += d * d;
      within_one += std::abs(d) < 1;
      beyond_two += std::abs(d) > 2;
    }
    EXPECT_NEAR(sum / 20000, 0, 0.03);
    EXPECT_NEAR(squares / 20000, 1, 0.04);
    EXPECT_NEAR(within_one / 20000.0, 0.683, 0.02);
    EXPECT_NEAR(beyond_two / 20000.0, 0.0455, 0.007);
  }
}

TEST(Perturbation, NothingBeyondTheRangeIsSeen) {
  const PointCloud cloud = hall(evenly(20, 2, -20), 200);
  const PointCloud seen = perturbed(cloud, "range=15");
  const auto near =
      std::ranges::count_if(cloud.points, [](const Point& p) { return std::hypot(p.x, p.y) < 15; });
  EXPECT_GT(near, 0);
  EXPECT_EQ(static_cast<int64_t>(seen.points.size()), near);
  for (const Point& p : seen.points) ASSERT_LT(std::hypot(p.x, p.y), 15);
}

TEST(Perturbation, RainIsNearOnTheSameRays) {
  const PointCloud cloud = hall(evenly(20, 2, -20), 500);
  const std::vector<Point> drops = nearer(cloud, perturbed(cloud, "rain=0.3"));
  EXPECT_NEAR(static_cast<double>(drops.size()), 3000, 4 * std::sqrt(10000 * 0.3 * 0.7));
  std::vector<double> ranges;
  for (const Point& p : drops) ranges.push_back(range_of(p));
  const auto [nearest, farthest] = std::ranges::minmax(ranges);
  EXPECT_NEAR(nearest, 0.5, 0.02);
  EXPECT_NEAR(farthest, 10, 0.05);
  const PointCloud wall{{{0.4F, 0, 0, 0}, {0, 3, 0, 1}}};
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const PointCloud wet = perturbed(wall, "rain=1", seed);
    EXPECT_EQ(wet.points[0].x, 0.4F) << "a wall nearer than any drop stays";
    EXPECT_LT(wet.points[1].y, 3) << "drops fall before the wall";
  }
}

TEST(Perturbation, ATruckHidesPointsBehindIt) {
  const PointCloud cloud = hall(evenly(64, 20, -25), 720);
  int left = 0;
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const std::vector<Point> hit = nearer(cloud, perturbed(cloud, "truck", seed));
    ASSERT_GT(hit.size(), 500u);
    const double side = hit[0].y > 0 ? 1 : -1;
    left += side > 0;
    double nearest = 100, rear = 100, front = -100, top = -100;
    for (const Point& p : hit) {
      nearest = std::min(nearest, side * p.y);
      rear = std::min(rear, double{p.x});
      front = std::max(front, double{p.x});
      top = std::max(top, double{p.z});
    }
    EXPECT_GE(nearest, 2 - 1e-5);
    EXPECT_LE(nearest, 4 + 1e-5);
    EXPECT_LE(front - rear, 8 + 1e-5);
    EXPECT_GT(front - rear, 7);
    EXPECT_LE(top, 3.5 - 1.7 + 1e-4);
    EXPECT_GT(top, 1.5);
    EXPECT_LT(rear, 0);  // the truck is beside the sensor, not before or behind it:
    EXPECT_GT(front, 0);
    for (const Point& p : hit) EXPECT_NEAR(side * p.y, nearest, 1e-4);  // one side is visible
  }
  EXPECT_GT(left, 3);
  EXPECT_LT(left, 17);
}

TEST(Perturbation, ASeedIsAlwaysTheSame) {
  const PointCloud cloud = hall(evenly(16, 15, -15), 360);
  for (const Perturbation& perturbation : standard_perturbations()) {
    PointCloud a = cloud, b = cloud, c = cloud;
    perturb(a, perturbation, 7);
    perturb(b, perturbation, 7);
    perturb(c, perturbation, 8);
    EXPECT_TRUE(same_points(a, b)) << text_of(perturbation);
    const std::string text = text_of(perturbation);
    const bool random = text.find_first_of("tks") == 0 || text.find("sector") != text.npos ||
                        text.starts_with("noise") || text.starts_with("rain=");
    EXPECT_EQ(same_points(a, c), !random) << text;
  }
}

TEST(Perturbation, RandomOnesHideEverySide) {
  // random_augmentation() and perturb() share the seed; their draws must be independent.
  std::array<int, 8> hidden{};  // by octant of azimuth
  PointCloud around;
  for (int i = 0; i < 360; ++i) {
    const double azimuth = (i + 0.5) * std::numbers::pi / 180;
    around.points.push_back({static_cast<float>(10 * std::cos(azimuth)),
                             static_cast<float>(10 * std::sin(azimuth)), 0, 0});
  }
  for (uint64_t seed = 0; seed < 20000; ++seed) {
    const Perturbation perturbation = random_augmentation(seed);
    if (perturbation.empty() || perturbation.front().kind != PerturbationStep::Kind::kSector)
      continue;
    PointCloud cloud = around;
    perturb(cloud, {perturbation.front()}, seed);
    std::array<int, 8> seen{};
    for (const Point& point : cloud.points)
      ++seen[static_cast<size_t>((std::atan2(point.y, point.x) / std::numbers::pi + 1) * 4)];
    for (size_t i = 0; i < hidden.size(); ++i) hidden[i] += 45 - seen[i];
  }
  const auto [least, most] = std::ranges::minmax(hidden);
  EXPECT_GT(least, 0.8 * most);
}

TEST(Perturbation, EachStandardOneIsDifferent) {
  std::map<std::string, int> names;
  for (const Perturbation& perturbation : standard_perturbations()) ++names[text_of(perturbation)];
  EXPECT_EQ(names.size(), standard_perturbations().size());
  EXPECT_EQ(names.size(), 19u);
  EXPECT_EQ(text_of(standard_perturbations().front()), "none");
}

TEST(Perturbation, RandomAugmentationsHaveEveryStep) {
  constexpr int kDrawn = 4000;
  using Kind = PerturbationStep::Kind;
  int none = 0;
  std::map<Kind, int> seen;
  double highest = 0, lowest = 0, steepest = 0, shortest = 1000;
  for (uint64_t seed = 0; seed < kDrawn; ++seed) {
    const Perturbation perturbation = random_augmentation(seed);
    EXPECT_EQ(text_of(perturbation), text_of(random_augmentation(seed)));
    EXPECT_EQ(text_of(parse_perturbation(text_of(perturbation))), text_of(perturbation));
    none += perturbation.empty();
    std::map<Kind, int> steps;
    double tilt = 0;
    for (const PerturbationStep& step : perturbation) {
      const double amount = step.amount.value_or(0);
      ++steps[step.kind];
      if (step.kind == Kind::kRoll || step.kind == Kind::kPitch) tilt = std::hypot(tilt, amount);
      if (step.kind == Kind::kHeight) {
        highest = std::max(highest, -amount);
        lowest = std::max(lowest, amount);
      }
      if (step.kind == Kind::kRange) shortest = std::min(shortest, amount);
    }
    steepest = std::max(steepest, tilt);
    for (const auto& [kind, count] : steps) {
      ++seen[kind];
      EXPECT_LE(count, kind == Kind::kSector ? 3 : 1);
    }
  }
  EXPECT_NEAR(none / double{kDrawn}, 0.25, 0.04);
  EXPECT_LE(steepest, 8);
  EXPECT_GT(steepest, 7.5);
  EXPECT_LE(std::max(highest, lowest), 1);
  EXPECT_GT(std::min(highest, lowest), 0.9);
  EXPECT_GE(shortest, 15);
  EXPECT_LT(shortest, 17);
  EXPECT_EQ(seen.count(Kind::kTurn), 0u);
  EXPECT_EQ(seen.size(), 10u);
  for (const auto& [kind, count] : seen) EXPECT_GT(count, kDrawn / 20);
}

}  // namespace
}  // namespace revisit
