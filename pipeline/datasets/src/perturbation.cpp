#include "revisit/datasets/perturbation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>

#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/recognition/range_image.h"

namespace revisit {
namespace {

using StepKind = PerturbationStep::Kind;
constexpr double kDegree = std::numbers::pi / 180;

struct KindRow {
  StepKind kind;
  const char *word, *expected;
  bool (*fits)(double amount);
  bool may_lack_amount = false;
};
bool is_tilt(double degrees) {
  return std::abs(degrees) <= 90;
}
bool is_fraction(double fraction) {
  return fraction > 0 && fraction <= 1;
}
constexpr KindRow kStepKinds[] = {
    {StepKind::kTurn, "turn", "-360 to 360 degrees, or none for any",
     [](double degrees) { return std::abs(degrees) <= 360; }, true},
    {StepKind::kRoll, "roll", "-90 to 90 degrees", is_tilt},
    {StepKind::kPitch, "pitch", "-90 to 90 degrees", is_tilt},
    {StepKind::kHeight, "height", "-100 to 100 meters",
     [](double meters) { return std::abs(meters) <= 100; }},
    {StepKind::kKeep, "keep", "a fraction of the points above 0, at most 1", is_fraction},
    {StepKind::kSector, "sector", "more than 0 and less than 360 degrees",
     [](double degrees) { return degrees > 0 && degrees < 360; }},
    {StepKind::kBeams, "beams", "a whole number from 2 to 64",
     [](double n) { return n >= 2 && n <= 64 && n == std::floor(n); }},
    {StepKind::kNoise, "noise", "more than 0, at most 10 meters",
     [](double meters) { return meters > 0 && meters <= 10; }},
    {StepKind::kRange, "range", "more than 0, at most 1000 meters",
     [](double meters) { return meters > 0 && meters <= 1000; }},
    {StepKind::kRain, "rain", "a fraction of the returns above 0, at most 1", is_fraction},
    {StepKind::kTruck, "truck", "no amount", nullptr, true},
};

const KindRow& row_of(StepKind kind) {
  return *std::ranges::find(kStepKinds, kind, [](const KindRow& row) { return row.kind; });
}

PerturbationStep parse_step(std::string_view text, std::string_view whole) {
  const size_t equals = text.find('=');
  const std::string word(text.substr(0, equals));
  const KindRow* const row =
      std::ranges::find_if(kStepKinds, [&](const KindRow& r) { return word == r.word; });
  if (row == std::end(kStepKinds)) {
    std::vector<std::string> words;
    for (const KindRow& known : kStepKinds) words.push_back(known.word);
    throw UsageError("perturbation '", whole, "': unknown step '", word, "'",
                     nearest_name_hint(word, words), "; known: ", joined(words, ", "),
                     "; or none alone");
  }
  PerturbationStep step{row->kind, std::nullopt};
  bool good = row->may_lack_amount;
  if (equals != std::string_view::npos) {
    step.amount = finite_number(text.substr(equals + 1));
    good = row->fits && step.amount && row->fits(*step.amount);
  }
  if (!good)
    throw UsageError("perturbation '", whole, "': ", word, " takes ", row->expected, ", found '",
                     text, "'");
  return step;
}

/// Random numbers that do not depend on the standard library, unlike std distributions.
class Draws {
 public:
  /// Purposes with one seed have independent streams.
  enum class Purpose : uint32_t { kChoose, kPerturb };
  Draws(uint64_t seed, Purpose purpose) {
    std::seed_seq mixed{static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32),
                        static_cast<uint32_t>(purpose)};
    random_.seed(mixed);
  }
  double uniform() { return static_cast<double>(random_() >> 11) * 0x1p-53; }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  bool chance(double probability) { return uniform() < probability; }
  /// Sum of twelve uniform values, about standard normal, with the same bits everywhere.
  double normal() {
    constexpr double kHalves = 12 * 0.5 * 0xffff;
    uint64_t sum = 0;
    for (int word = 0; word < 3; ++word)
      for (uint64_t bits = random_(), i = 0; i < 4; ++i, bits >>= 16) sum += bits & 0xffff;
    return (static_cast<double>(sum) - kHalves) * 0x1p-16;
  }

 private:
  std::mt19937_64 random_;
};

double elevation_of(const Point& p) {
  return std::atan2(double{p.z}, std::hypot(double{p.x}, double{p.y})) / kDegree;
}

void keep_every_beam(std::vector<Point>& points, int n) {
  constexpr int kRows = 64;
  const SensorFound found = find_beams({PointCloud{points}});
  std::vector<double> borders;  // [deg], between two beams, lowest first
  if (found.elevations.empty()) {
    for (int i = 1; i < kRows; ++i)
      borders.push_back(found.bottom + (found.top - found.bottom) * i / kRows);
  } else {
    for (size_t i = found.elevations.size(); --i > 0;)
      borders.push_back((found.elevations[i] + found.elevations[i - 1]) / 2);
  }
  std::erase_if(points, [&](const Point& p) {
    return (std::ranges::upper_bound(borders, elevation_of(p)) - borders.begin()) % n != 0;
  });
}

void turn(std::vector<Point>& points, double degrees, float Point::*from, float Point::*to) {
  const double c = std::cos(degrees * kDegree), s = std::sin(degrees * kDegree);
  for (Point& p : points) {
    const double a = p.*from, b = p.*to;
    p.*from = static_cast<float>(c * a - s * b);
    p.*to = static_cast<float>(s * a + c * b);
  }
}

void hide_sector(std::vector<Point>& points, double width, double azimuth) {
  std::erase_if(points, [&](const Point& p) {
    const double there = std::atan2(double{p.y}, double{p.x}) / kDegree;
    return std::abs(std::remainder(there - azimuth, 360)) <= width / 2;
  });
}

double range_of(const Point& p) {
  return std::sqrt(double{p.x} * p.x + double{p.y} * p.y + double{p.z} * p.z);
}

void move_along_ray(Point& p, double fraction) {
  p.x = static_cast<float>(p.x * fraction);
  p.y = static_cast<float>(p.y * fraction);
  p.z = static_cast<float>(p.z * fraction);
}

void let_it_rain(std::vector<Point>& points, double fraction, Draws& draws) {
  constexpr double kNearest = 0.5, kMaxRange = 10;  // [m]
  for (Point& p : points) {
    if (!draws.chance(fraction)) continue;
    const double range = range_of(p), farthest = std::min(kMaxRange, range);
    if (farthest > kNearest) move_along_ray(p, draws.uniform(kNearest, farthest) / range);
  }
}

/// 10 % quantile of the heights near the sensor [m]
double ground_of(const std::vector<Point>& points) {
  constexpr double kNear = 15, kTypical = -1.7;  // [m]
  std::vector<float> heights;
  for (const Point& p : points)
    if (std::hypot(p.x, p.y) < kNear) heights.push_back(p.z);
  if (heights.empty()) return kTypical;
  const auto tenth = heights.begin() + static_cast<std::ptrdiff_t>(heights.size() / 10);
  std::ranges::nth_element(heights, tenth);
  return *tenth;
}

void put_truck(std::vector<Point>& points, Draws& draws) {
  constexpr double kWide = 2.5, kLong = 8, kHigh = 3.5;  // [m]
  const double ground = ground_of(points);
  const double aside = draws.uniform(2, 4), ahead = draws.uniform(-kLong / 2, kLong / 2);
  const bool left = draws.chance(0.5);
  const std::array<double, 3> low{ahead - kLong / 2, left ? aside : -aside - kWide, ground};
  const std::array<double, 3> high{low[0] + kLong, low[1] + kWide, ground + kHigh};
  for (Point& p : points) {
    // Ray parameters at which the ray from the sensor enters and leaves the box; 1 at the point.
    double enters = 0, leaves = 1;
    const std::array<double, 3> way{p.x, p.y, p.z};
    for (size_t axis = 0; axis < way.size(); ++axis) {
      if (way[axis] == 0) {
        if (low[axis] > 0 || high[axis] < 0) leaves = -1;
        continue;
      }
      const auto [first, last] = std::minmax({low[axis] / way[axis], high[axis] / way[axis]});
      enters = std::max(enters, first);
      leaves = std::min(leaves, last);
    }
    if (enters > 0 && enters < leaves) move_along_ray(p, enters);
  }
}

void take_step(std::vector<Point>& points, const PerturbationStep& step, Draws& draws) {
  const double amount = step.amount.value_or(0);
  switch (step.kind) {
    case StepKind::kTurn:
      return turn(points, step.amount ? amount : draws.uniform(-180, 180), &Point::x, &Point::y);
    case StepKind::kRoll:
      return turn(points, amount, &Point::y, &Point::z);
    case StepKind::kPitch:
      return turn(points, amount, &Point::z, &Point::x);
    case StepKind::kHeight:
      for (Point& p : points) p.z = static_cast<float>(p.z + amount);
      return;
    case StepKind::kKeep:
      std::erase_if(points, [&](const Point&) { return !draws.chance(amount); });
      return;
    case StepKind::kSector:
      return hide_sector(points, amount, draws.uniform(-180, 180));
    case StepKind::kBeams:  // already applied
      return;
    case StepKind::kNoise:
      for (Point& p : points)
        for (float Point::*axis : {&Point::x, &Point::y, &Point::z})
          p.*axis = static_cast<float>(p.*axis + amount * draws.normal());
      return;
    case StepKind::kRange:
      std::erase_if(points,
                    [&](const Point& p) { return std::hypot(double{p.x}, double{p.y}) >= amount; });
      return;
    case StepKind::kRain:
      return let_it_rain(points, amount, draws);
    case StepKind::kTruck:
      return put_truck(points, draws);
  }
}

}  // namespace

Perturbation parse_perturbation(std::string_view text) {
  Perturbation perturbation;
  if (text == "none") return perturbation;
  for (size_t begin = 0; begin <= text.size();) {
    const size_t end = std::min(text.find('+', begin), text.size());
    perturbation.push_back(parse_step(text.substr(begin, end - begin), text));
    begin = end + 1;
  }
  return perturbation;
}

std::string text_of(const Perturbation& perturbation) {
  if (perturbation.empty()) return "none";
  return joined(perturbation, "+", [](const PerturbationStep& step) {
    return row_of(step.kind).word + (step.amount ? "=" + exact(*step.amount) : "");
  });
}

std::vector<Perturbation> standard_perturbations() {
  std::vector<Perturbation> all;
  for (const char* text :
       {"none", "turn", "keep=0.5", "keep=0.2", "roll=5", "pitch=5", "height=1", "sector=60",
        "sector=120", "sector=180", "sector=60+sector=60", "beams=2", "beams=4", "noise=0.2",
        "range=30", "range=15", "rain=0.3", "truck", "range=40+pitch=3+sector=50+sector=50"})
    all.push_back(parse_perturbation(text));
  return all;
}

Perturbation random_augmentation(uint64_t seed) {
  Draws draws(seed, Draws::Purpose::kChoose);
  Perturbation perturbation;
  const auto add = [&](StepKind kind, double amount) {
    constexpr double kHundred = 100;  // rounds to two decimals for readability
    amount = std::round(amount * kHundred) / kHundred;
    if (row_of(kind).fits(amount)) perturbation.push_back({kind, amount});
  };
  if (draws.chance(0.25)) return perturbation;
  if (draws.chance(0.25)) add(StepKind::kBeams, std::floor(draws.uniform(2, 5)));
  if (draws.chance(0.5)) {
    const double tilt = draws.uniform(0, 7.99), towards = draws.uniform(-180, 180) * kDegree;
    add(StepKind::kRoll, tilt * std::cos(towards));
    add(StepKind::kPitch, tilt * std::sin(towards));
  }
  if (draws.chance(0.5)) add(StepKind::kHeight, draws.uniform(-1, 1));
  if (draws.chance(0.15)) perturbation.push_back({StepKind::kTruck, std::nullopt});
  for (int sector = 0; sector < 3 && draws.chance(0.45); ++sector)
    add(StepKind::kSector, draws.uniform(20, 120));
  if (draws.chance(0.35)) add(StepKind::kRange, draws.uniform(15, 60));
  if (draws.chance(0.2)) add(StepKind::kRain, draws.uniform(0.02, 0.4));
  if (draws.chance(0.3)) add(StepKind::kKeep, draws.uniform(0.2, 0.9));
  if (draws.chance(0.3)) add(StepKind::kNoise, draws.uniform(0.02, 0.25));
  return perturbation;
}

void perturb(PointCloud& cloud, const Perturbation& perturbation, uint64_t seed) {
  if (perturbation.empty()) return;
  std::vector<Point>& points = cloud.points;
  std::erase_if(points, [](const Point& p) { return !is_return(p); });
  for (const PerturbationStep& step : perturbation)
    if (step.kind == StepKind::kBeams) keep_every_beam(points, static_cast<int>(*step.amount));
  Draws draws(seed, Draws::Purpose::kPerturb);
  for (const PerturbationStep& step : perturbation) take_step(points, step, draws);
}

}  // namespace revisit
