#include "float_matrix.h"
#include "revisit/proto/npy.h"
#include "revisit/recognition/feature_file.h"
#include "revisit/recognition/ring/descriptor.h"
#include "revisit/recognition/ring/model.h"
#include "ring/correlation.h"
#include "ring/describer.h"
#include "ring/spectrum.h"
#include "testing.h"

namespace revisit {
namespace {

/// Untrained, with the sizes of tests/fixtures/ring.
RingModel small_model() {
  RingModel model;
  model.sensor = "none";
  model.prototxt = "name: \"none\"";
  model.weights = std::string("\0weights", 8);
  model.image.width = 1024;
  model.image.height = 16;
  RingLayer& layer = model.layers.emplace_back();
  layer.name = "pool";
  layer.mean = {1, 2, 3, 4};
  layer.directions = FloatMatrix(3, 4);
  for (int i = 0; i < 3; ++i) layer.directions.row(i)[static_cast<size_t>(i)] = 1;
  model.grid = {.sectors = 36, .distances = {0, 10, 20}, .bands = {}};
  model.cnn = {.sectors = 40, .features = 3};
  model.polar = {.sectors = 36, .features = 2, .weights = 2, .mirrored = true};
  return model;
}

struct Learnt {
  FeatureFile rings{test::fixture("ring/rings.npy")};
  RingModel model = small_model();
  std::vector<int64_t> scans;
  std::vector<RingPair> pairs;

  Learnt() {
    for (int64_t i = 0; i < rings.n(); ++i) scans.push_back(i);
    const proto::Blob rows = proto::read_npy(test::fixture("ring/pairs.npy"));
    for (size_t i = 0; i < rows.data.size(); i += 3)
      pairs.push_back({static_cast<int64_t>(rows.data[i]), static_cast<int64_t>(rows.data[i + 1]),
                       static_cast<double>(rows.data[i + 2])});
    const RingDrive drive{rings.rows(), scans, pairs};
    train_rings(model, {&drive, 1});
  }
  RingDescriber describer(const RingOptions& options = {.dim = 60}) const {
    return RingDescriber(model, options);
  }
  FloatMatrix descriptors(const RingDescriber& describer) const {
    FloatMatrix all(rings.n(), dim_of(describer.layout()));
    for (int64_t i = 0; i < rings.n(); ++i) describer.describe(rings.row(i), all.row(i));
    return all;
  }
};

RingModel without_mean(RingModel model) {
  for (RingStatistics* ring : {&model.cnn, &model.polar})
    ring->mean.assign(static_cast<size_t>(ring->size()), 0.0F);
  return model;
}

/// Rotates rings of 40 and 36 sectors, and their weights, with wrap-around.
std::vector<float> rotated(std::span<const float> rings, int shift40, int shift36) {
  std::vector<float> result;
  for (const auto& [rows, sectors, shift] :
       {std::array{3, 40, shift40}, {2, 36, shift36}, {1, 40, shift40}, {2, 36, shift36}})
    for (int r = 0; r < rows; ++r) {
      const auto row = rings.first(static_cast<size_t>(sectors));
      rings = rings.subspan(row.size());
      for (int k = 0; k < sectors; ++k)
        result.push_back(row[static_cast<size_t>((k + shift) % sectors)]);
    }
  return result;
}

/// Reference: term by term, for all yaw angles.
double slow_similarity(std::span<const float> a, std::span<const float> b,
                       const RingLayout& layout) {
  double best = -2;
  for (int s = 0; s < 360; ++s) {
    double sum = 0;
    size_t at = 0;
    for (size_t f = 0; f < layout.size(); ++f) {
      const auto n = static_cast<size_t>(layout[f]);
      for (size_t i = at; i < at + n; ++i) {
        const std::complex<double> x(a[i], f ? a[i + n] : 0), y(b[i], f ? b[i + n] : 0);
        sum +=
            (x * std::conj(y) * std::polar(1.0, kTurn * static_cast<double>(f) * s / 360)).real();
      }
      at += f ? 2 * n : n;
    }
    best = std::max(best, sum);
  }
  return best;
}

TEST(RingReference, SimilaritiesAndTurnsOfNumpy) {
  const Learnt learnt;
  const RingDescriber describer = learnt.describer();
  const FloatMatrix descriptors = learnt.descriptors(describer);
  const proto::Blob similarity = proto::read_npy(test::fixture("ring/similarity.npy"));
  const proto::Blob turn = proto::read_npy(test::fixture("ring/turn.npy"));
  const Comparison ours = ring_comparison(describer.layout());
  std::vector<double> row(60);
  for (int64_t a = 0; a < 60; ++a) {
    ours.similarity(descriptors.row(a), rows_of(descriptors, learnt.scans), row);
    for (int64_t b = 0; b < 60; ++b) {
      const auto at = static_cast<size_t>(a * 60 + b);
      EXPECT_NEAR(row[static_cast<size_t>(b)], similarity.data[at], 2e-5) << a << " " << b;
      if (similarity.data[at] < 0.5F) continue;  // the relative yaw to another place is random
      const RingMatch match =
          match_rings(descriptors.row(a), descriptors.row(b), describer.layout());
      // NumPy's yaw is a whole degree.
      EXPECT_LT(std::abs(std::remainder(match.relative_yaw - turn.data[at], kTurn)),
                0.51 * kTurn / 360)
          << a << " " << b;
      // The maximum between two whole degrees is at most 1 - cos(16 * 0.5 deg) higher.
      EXPECT_GE(match.similarity, similarity.data[at] - 2e-5);
      EXPECT_LE(match.similarity, similarity.data[at] + 0.0098);
    }
  }
}

TEST(RingReference, ScansOfOnePlaceAreFoundAndTheirTurnToo) {
  const Learnt learnt;
  const RingDescriber describer = learnt.describer();
  const FloatMatrix descriptors = learnt.descriptors(describer);
  double error = 0;
  for (const RingPair& pair : learnt.pairs) {
    const RingMatch match =
        match_rings(descriptors.row(pair.a), descriptors.row(pair.b), describer.layout());
    error += std::abs(std::remainder(match.relative_yaw - pair.relative_yaw, kTurn));
  }
  EXPECT_LT(error / static_cast<double>(learnt.pairs.size()), 0.05);
}

TEST(RingDescriber, ATurnByWholeSectorsIsReturnedExactly) {
  const Learnt learnt;
  const RingDescriber describer(without_mean(learnt.model), {.dim = 60});
  std::vector<float> a(static_cast<size_t>(dim_of(describer.layout()))), b = a;
  describer.describe(learnt.rings.row(3), a);
  for (const int quarter : {0, 1, 2, 3}) {
    // Content `shift` sectors ahead corresponds to a clockwise rotation, because azimuth decreases
    // with the sector.
    describer.describe(rotated(learnt.rings.row(3), 10 * quarter, 9 * quarter), b);
    const RingMatch match = match_rings(a, b, describer.layout());
    EXPECT_NEAR(match.similarity, 1, 1e-5);
    EXPECT_NEAR(std::remainder(match.relative_yaw + kTurn * quarter / 4, kTurn), 0, 1e-5)
        << quarter;
    // Only phases change: each frequency keeps its norm.
    size_t at = 0;
    for (size_t f = 0; f < describer.layout().size(); ++f) {
      const auto n = static_cast<size_t>(describer.layout()[f]) * (f ? 2 : 1);
      double lengths[2] = {};
      for (size_t i = at; i < at + n; ++i) {
        lengths[0] += static_cast<double>(a[i]) * a[i];
        lengths[1] += static_cast<double>(b[i]) * b[i];
      }
      EXPECT_NEAR(lengths[0], lengths[1], 1e-6);
      at += n;
    }
  }
}

TEST(RingSimilarity, IsTheLargestOverAllTurnsAndSymmetric) {
  const Learnt learnt;
  for (const int numbers : {2, 12, 60, 170, 1024}) {
    const RingDescriber describer = learnt.describer({.dim = numbers});
    EXPECT_LE(dim_of(describer.layout()), numbers);
    const FloatMatrix descriptors = learnt.descriptors(describer);
    const auto similarity = ring_comparison(describer.layout()).similarity;
    for (const int64_t a : {0, 7, 33}) {
      std::vector<double> row(learnt.scans.size()), back(1);
      similarity(descriptors.row(a), rows_of(descriptors, learnt.scans), row);
      for (size_t b = 0; b < row.size(); b += 5) {
        const auto other = static_cast<int64_t>(b);
        EXPECT_NEAR(row[b],
                    slow_similarity(descriptors.row(a), descriptors.row(other), describer.layout()),
                    3e-6);
        similarity(descriptors.row(other), rows_of(descriptors, std::vector<int64_t>{a}), back);
        EXPECT_NEAR(row[b], back[0], 3e-6);
      }
    }
  }
}

TEST(RingSimilarity, OfAScanThatIsTheMeanIsZero) {
  const Learnt learnt;
  const RingDescriber describer = learnt.describer();
  FloatMatrix descriptors = learnt.descriptors(describer);
  std::vector<float> mean = learnt.model.cnn.mean;
  mean.insert(mean.end(), learnt.model.polar.mean.begin(), learnt.model.polar.mean.end());
  mean.resize(static_cast<size_t>(learnt.model.dim()), 1.0F);  // all of it seen
  describer.describe(mean, descriptors.row(5));
  std::vector<double> row(learnt.scans.size());
  ring_comparison(describer.layout())
      .similarity(descriptors.row(5), rows_of(descriptors, learnt.scans), row);
  for (const double similarity : row) EXPECT_EQ(similarity, 0);
  // All yaw angles are equally good.
  EXPECT_EQ(match_rings(descriptors.row(5), descriptors.row(3), describer.layout()).relative_yaw,
            0);
}

/// Rings of independent Gaussian features: place and scan have known variances.
TEST(RingLearning, ClosedFormOfGaussians) {
  constexpr int kPlaces = 1500;
  const double place_deviation[] = {3, 1, 0.5}, scan_deviation = 1;
  std::mt19937 random(5);
  std::normal_distribution<double> gaussian;
  const TempDir folder;
  RingModel model = small_model();
  std::vector<float> rings;
  std::vector<RingPair> pairs;
  for (int place = 0; place < kPlaces; ++place) {
    std::vector<float> seen(192);
    for (size_t i = 0; i < 192; ++i)
      seen[i] = static_cast<float>(place_deviation[i < 120 ? i / 40 : (i - 120) / 36 * 2] *
                                   gaussian(random));
    for (int scan = 0; scan < 2; ++scan) {
      for (const float value : seen)
        rings.push_back(value + static_cast<float>(scan_deviation * gaussian(random)));
      rings.insert(rings.end(), 112, 1.0F);
    }
    pairs.push_back({2 * place, 2 * place + 1, 0});
  }
  proto::write_npy(folder / "rings.npy", {2 * kPlaces, 304}, rings.data());
  const FeatureFile file(folder / "rings.npy");
  RingDrive drive{file.rows(), {}, pairs};
  for (int64_t i = 0; i < file.n(); ++i) drive.scans.push_back(i);
  train_rings(model, {&drive, 1});
  for (int f = 1; f < 17; ++f)
    for (int i = 0; i < 3; ++i) {
      const double place = std::pow(place_deviation[i], 2);
      const auto at = static_cast<size_t>(f);
      EXPECT_NEAR(model.cnn.total[at](i, i).real(), place + 1, 0.15 * (place + 1));
      EXPECT_NEAR(model.cnn.shared[at](i, i).real(), place, 0.15 * (place + 1));
    }
  // Eigenvalues are 9/10, 1/2 and 1/5: with 16 frequencies of two dimensions and one of one, the
  // first feature alone fills 33.
  const RingDescriber describer(without_mean(model), {.dim = 66});
  std::vector<float> descriptor(static_cast<size_t>(dim_of(describer.layout())));
  std::vector<float> first(192), third(192);
  first.resize(304, 1.0F);
  third.resize(304, 1.0F);
  for (size_t k = 0; k < 40; ++k) first[k] = third[80 + k] = static_cast<float>(gaussian(random));
  const auto length_of = [&](const std::vector<float>& x) {
    describer.describe(x, descriptor);
    double square = 0;
    for (const float value : descriptor) square += static_cast<double>(value) * value;
    return std::sqrt(square);
  };
  EXPECT_NEAR(length_of(first), std::sqrt(0.3), 1e-5);  // the weight of this ring
  for (size_t f = 0; f < 17; ++f) EXPECT_EQ(describer.layout()[f], 2) << f;
}

TEST(RingLearning, AlteredScansTeachAsTheirMeanOverAllPairsOfWays) {
  const Learnt learnt;
  const RingPart part = parts_of(learnt.model)[1];
  // With another place's ring as augmentation, only what both share remains.
  const auto own = [&](int64_t i) { return learnt.rings.row(i); };
  const auto other = [&](int64_t i) { return learnt.rings.row((i + 7) % 60); };
  const std::function<std::span<const float>(int64_t)> ways[] = {own, other};
  const RingDrive drive{
      learnt.rings.rows(), learnt.scans, learnt.pairs, {Rows{60, learnt.model.dim(), other}}};
  RingModel model = small_model();
  train_rings(model, {&drive, 1});
  EXPECT_EQ(model.polar.mean, learnt.model.polar.mean);  // of unaugmented scans
  const Spectrum spectrum(part.sectors);
  for (const int f : {0, 3, 16}) {
    const auto x = [&](std::span<const float> feature) -> Eigen::VectorXcd {
      return spectrum.of(feature.data(), model.polar.mean.data(), part)
          .row(f)
          .transpose()
          .cast<std::complex<double>>();
    };
    Eigen::MatrixXcd total = Eigen::MatrixXcd::Zero(2, 2), shared = total;
    for (const int64_t i : learnt.scans)
      for (const auto& way : ways) total += x(way(i)) * x(way(i)).adjoint() / 2 / 60;
    for (const RingPair& pair : learnt.pairs)
      for (const auto& a : ways)
        for (const auto& b : ways)
          shared += x(a(pair.a)) * x(b(pair.b)).adjoint() *
                    std::polar(1.0, -f * pair.relative_yaw) / 4 /
                    static_cast<double>(learnt.pairs.size());
    const auto at = static_cast<size_t>(f);
    EXPECT_LT((model.polar.total[at].real() - total.real()).norm(), 1e-4 * total.norm());
    EXPECT_LT(
        (model.polar.shared[at].real() - (shared.real() + shared.real().transpose()) / 2).norm(),
        1e-4 * total.norm());
    EXPECT_EQ(model.polar.total[at].imag().norm(), 0);  // mirrored
  }
}

TEST(RingDescriber, TheUnitOfColumnsDoesNotMatter) {
  const RingStatistics ring = Learnt().model.cnn;
  RingStatistics small = ring;
  for (float& number : small.mean) number /= 256;
  for (auto* spreads : {&small.total, &small.shared})
    for (Eigen::MatrixXcd& spread : *spreads) spread /= 256 * 256;
  ASSERT_LT(trace(small.total), 1);
  const RingProjection expected = project_rings(ring, 0.1, 30),
                       found = project_rings(small, 0.1, 30);
  for (size_t f = 0; f < expected.size(); ++f) {
    ASSERT_EQ(found[f].rows(), expected[f].rows());
    EXPECT_LE((found[f] - expected[f]).norm(), 1e-4F * expected[f].norm());
  }
}

TEST(RingDescriber, DropsDirectionsThatScansOfAPlaceDoNotShare) {
  RingStatistics ring = Learnt().model.cnn;
  for (size_t f = 0; f < ring.shared.size(); ++f)
    if (f != 2) ring.shared[f].setZero();
  const RingProjection projection = project_rings(ring, 0.1, 30);
  for (size_t f = 0; f < projection.size(); ++f) EXPECT_EQ(projection[f].rows() > 0, f == 2);
}

TEST(RingDescriber, HiddenSectorsHaveTheMean) {
  const Learnt learnt;
  const RingDescriber describer = learnt.describer();
  std::vector<float> hidden(learnt.rings.row(1).begin(), learnt.rings.row(1).end()), same = hidden;
  const std::array<RingPart, 2> parts = parts_of(learnt.model);
  for (const RingPart& part : parts)
    for (int i = 0; i < part.features; ++i)
      for (int k = 3; k < 12; ++k) {
        const auto at = static_cast<size_t>(part.first + i * part.sectors + k);
        hidden[at] = 1e6F;  // arbitrary, because its weight is 0
        hidden[static_cast<size_t>(part.first_weight + i % part.weights * part.sectors + k)] = 0;
        same[at] = (&part == parts.data() ? learnt.model.cnn : learnt.model.polar)
                       .mean[at - static_cast<size_t>(part.first)];
      }
  std::vector<float> a(static_cast<size_t>(dim_of(describer.layout()))), b = a;
  describer.describe(hidden, a);
  describer.describe(same, b);
  for (size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], b[i], 1e-5);
}

TEST(RingLearning, FromScansAloneEqualsVariances) {
  Learnt learnt;
  const RingDrive drive{learnt.rings.rows(), learnt.scans, {}};
  train_rings(learnt.model, {&drive, 1});
  EXPECT_TRUE(learnt.model.cnn.shared.empty());
  const RingDescriber describer = learnt.describer({.dim = 170});
  const FloatMatrix descriptors = learnt.descriptors(describer);
  const Comparison rings = ring_comparison(describer.layout());
  int found = 0;
  std::vector<double> row(60);
  for (int64_t a = 0; a < 60; ++a) {
    rings.similarity(descriptors.row(a), rows_of(descriptors, learnt.scans), row);
    row[static_cast<size_t>(a)] = -2;
    found += (std::max_element(row.begin(), row.end()) - row.begin() - a) % 20 == 0;
  }
  EXPECT_GE(found, 58);
}

TEST(RingLearning, RejectsInvalidTrainingData) {
  Learnt learnt;
  expect_error<UsageError>([&] { train_rings(learnt.model, {}); }, {"at least one drive"});
  const RingDrive one{learnt.rings.rows(), {3}, {}};
  expect_error<UsageError>([&] { train_rings(learnt.model, {&one, 1}); }, {"at least 2 scans"});
  RingModel other = small_model();
  other.cnn.features = 4;
  const RingDrive all{learnt.rings.rows(), learnt.scans, {}};
  expect_error<InputError>([&] { train_rings(other, {&all, 1}); }, {"304", "344"});
  expect_error<UsageError>([&] { learnt.describer({.dim = 1}); }, {"dimensions", "found 1"});
  expect_error<UsageError>([&] { learnt.describer({.dim = 65537}); }, {"2 to 65536"});
  expect_error<UsageError>([&] { learnt.describer({.dim = 60, .regularization = 0}); },
                           {"regularization", "found 0"});
  const Rows rings = learnt.rings.rows();
  expect_error<UsageError>([&] { fit_to_map(learnt.model, rings, learnt.scans, 2); },
                           {"blend", "found 2"});
  expect_error<UsageError>([&] { learnt.describer({.dim = 60, .blend = 1.01}); },
                           {"blend", "0 to 1"});
  learnt.describer({.dim = 60, .blend = 1});
  expect_error<UsageError>([&] { fit_to_map(learnt.model, rings, {}, 0); }, {"at least 1 scan"});
  expect_error<UsageError>([&] { learnt.describer({.candidates = -1}); },
                           {"candidates", "found -1"});
}

TEST(RingModelFile, RoundTrips) {
  const Learnt learnt;
  const TempDir folder;
  write_ring_model(folder / "a.ring", learnt.model);
  const RingModel read = read_ring_model(folder / "a.ring");
  EXPECT_EQ(read.weights, learnt.model.weights);
  EXPECT_EQ(read.image.height, 16);
  EXPECT_EQ(read.scans, 60);
  EXPECT_EQ(read.layers[0].directions.values, learnt.model.layers[0].directions.values);
  EXPECT_EQ(read.cnn.mean, learnt.model.cnn.mean);
  for (size_t f = 0; f < 17; ++f) {
    EXPECT_LT((read.cnn.total[f] - learnt.model.cnn.total[f]).norm(), 1e-5);
    EXPECT_LT((read.polar.shared[f] - learnt.model.polar.shared[f]).norm(), 1e-5);
  }
  write_ring_model(folder / "b.ring", read);
  EXPECT_EQ(read_file(folder / "a.ring"), read_file(folder / "b.ring"));
}

TEST(RingModelFile, KeepsItsCalibration) {
  Learnt learnt;
  EXPECT_FALSE(parse_ring_model(ring_model_content(learnt.model), "x").calibration);
  learnt.model.calibration.emplace();
  learnt.model.calibration->trained_on = "towns";
  learnt.model.calibration->blocks = {{0.1, 50, 0}, {0.6, 900, 899.5}};
  const std::string content = ring_model_content(learnt.model);
  EXPECT_EQ(parse_ring_model(content, "x").calibration, learnt.model.calibration);
  learnt.model.calibration->blocks[1].correct = 1000;
  expect_error<InputError>([&] { parse_ring_model(ring_model_content(learnt.model), "x.ring"); },
                           {"x.ring", "1000 of 900"});
}

TEST(RingModelFile, RejectsOtherFormatsWithAdvice) {
  const Learnt learnt;
  std::string content = ring_model_content(learnt.model);
  ASSERT_EQ(content.substr(0, 2), std::string("\x08\x02"));  // field 1, the version
  content[1] = 1;
  expect_error<InputError>([&] { parse_ring_model(content, "x.ring"); },
                           {"x.ring", "format 1", "reads format 2", "train it again"});
  content[1] = 3;
  expect_error<InputError>([&] { parse_ring_model(content, "x.ring"); },
                           {"format 3", "update this program"});
}

TEST(RingModelFile, RefusesADamagedOne) {
  const Learnt learnt;
  const TempDir folder;
  write_ring_model(folder / "a.ring", learnt.model);
  const std::string whole = read_file(folder / "a.ring");
  for (size_t at = 0; at < whole.size(); at += 1 + whole.size() / 97) {
    std::string damaged = whole;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x10);
    expect_error<InputError>([&] { parse_ring_model(damaged, "x.ring"); }, {"x.ring"});
    expect_error<InputError>([&] { parse_ring_model(whole.substr(0, at), "x.ring"); }, {"x.ring"});
  }
  RingModel unfit = learnt.model;
  unfit.polar.mean.pop_back();
  write_ring_model(folder / "b.ring", unfit);
  expect_error<InputError>([&] { read_ring_model(folder / "b.ring"); },
                           {"b.ring", "71 values", "expected 72"});
  unfit = learnt.model;
  unfit.cnn.total[3](1, 1) = -0.01;
  expect_error<InputError>([&] { parse_ring_model(ring_model_content(unfit), "c.ring"); },
                           {"c.ring", "CNN ring total covariance", "a variance below 0"});
}

}  // namespace
}  // namespace revisit
