#include "float_matrix.h"
#include "revisit/datasets/describe.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/datasets/train_ring.h"
#include "revisit/recognition/align.h"
#include "revisit/recognition/range_image.h"
#include "revisit/recognition/ring/descriptor.h"
#include "ring/correlation.h"
#include "ring/describer.h"
#include "testing.h"

namespace revisit {
namespace {

constexpr const char* kSqueezeNet = "0c5ba9eceae67db71dbfde095d807f4e1006c946";  // SHA-1

TEST(ShippedRingModel, IsForItsSensorAndSmall) {
  for (const std::string& sensor : shipped_ring_models())
    for (const char* weights : {"", kSqueezeNet}) {
      if (*weights != '\0' && sensor == "livox-mid360") continue;
      const RingModel model = shipped_ring_model(sensor, weights);
      EXPECT_EQ(model.sensor, sensor);
      EXPECT_TRUE(*weights == '\0' || model.weights_sha1 == weights);
      const ImageGeometry image = ring_geometry(sensor);
      EXPECT_EQ(model.image.height, image.height);
      EXPECT_EQ(model.image.elevation_top, image.elevation_top);
      const TempDir folder;
      write_ring_model(folder / "model", model);
      EXPECT_LT(std::filesystem::file_size(folder / "model"), 2U << 20);
    }
  expect_error<UsageError>([] { shipped_ring_model("hdl64", "0123"); }, {"these weights"});
  expect_error<UsageError>([] { shipped_ring_model("hdl32"); },
                           {"hdl64, vlp16, ouster-os1-64, livox-mid360", "leave the sensor out"});
  expect_error<UsageError>([] { shipped_ring_model("livox-mid360", kSqueezeNet); },
                           {"for hdl64, vlp16, ouster-os1-64;"});
}

TEST(ShippedRingModel, TakesNoBasisOfAnotherSize) {
  const RingModel model = shipped_ring_model("vlp16");
  const FeatureExtractor extractor = ring_recognizer(model, ring_net(model), {});
  EXPECT_GT(extractor.open_projection(ring_model_content(model)).dim, 0);
  RingModel other = model;
  other.grid.sectors = other.polar.sectors = model.polar.sectors / 2;
  other.polar.mean.resize(static_cast<size_t>(other.polar.size()));
  expect_error<InputError>(
      [&] { extractor.open_projection(ring_model_content(other)); },
      {std::to_string(other.dim()) + " floats, expected " + std::to_string(model.dim())});
}

/// Returns lie in pixel centers, also after a rotation by whole columns.
PointCloud in_the_middle_of_pixels(const PointCloud& scan, const ImageGeometry& image,
                                   int columns_on) {
  PointCloud moved;
  for (const Point& p : scan.points) {
    const double range = std::hypot(p.x, p.y, p.z);
    const double column =
        std::floor((std::numbers::pi - std::atan2(p.y, p.x)) / kTurn * image.width);
    const double azimuth = std::numbers::pi - (column + 0.5 + columns_on) / image.width * kTurn;
    const double elevation = std::asin(p.z / range);
    moved.points.push_back({static_cast<float>(range * std::cos(elevation) * std::cos(azimuth)),
                            static_cast<float>(range * std::cos(elevation) * std::sin(azimuth)),
                            p.z, 0});
  }
  return moved;
}

/// A quarter revolution is a multiple of columns, of sectors of both rings, and of strides.
TEST(RingFeatures, TurnWithTheScan) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  const RingModel model = shipped_ring_model("hdl64");
  const auto parts_of =
      std::get<FeatureMaker<PointCloud>>(ring_features(model, ring_net(model)).make)();
  const PointCloud scan = read_scan(kitti / "sequences/00/velodyne/000052.bin");
  std::vector<float> still(static_cast<size_t>(model.dim())), turned = still;
  parts_of(in_the_middle_of_pixels(scan, model.image, 0), still);
  parts_of(in_the_middle_of_pixels(scan, model.image, model.image.width / 4), turned);
  double difference = 0, size = 0;
  size_t first = 0;
  for (const RingStatistics* ring : {&model.cnn, &model.polar})
    for (int i = 0; i < ring->features; ++i, first += static_cast<size_t>(ring->sectors))
      for (int k = 0; k < ring->sectors; ++k) {
        const int from = (k + ring->sectors - ring->sectors / 4) % ring->sectors;
        const double a = still[first + static_cast<size_t>(from)],
                     b = turned[first + static_cast<size_t>(k)];
        difference += (a - b) * (a - b);
        size += a * a;
      }
  EXPECT_LT(std::sqrt(difference / size), 0.02);
}

/// Residual when the mean rotates with the scan: effects of sector, row and bin borders.
TEST(RingFeatures, AScanTurnedByAnyYawIsItself) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  RingModel model = shipped_ring_model("hdl64");
  for (RingStatistics* ring : {&model.cnn, &model.polar})
    for (auto row = ring->mean.begin(); row != ring->mean.end(); row += ring->sectors)
      std::fill_n(
          row, ring->sectors,
          std::accumulate(row, row + ring->sectors, 0.0F) / static_cast<float>(ring->sectors));
  const auto parts_of =
      std::get<FeatureMaker<PointCloud>>(ring_features(model, ring_net(model)).make)();
  const RingDescriber describer(model);
  const auto describe = [&](const PointCloud& scan) {
    std::vector<float> rings(static_cast<size_t>(model.dim())),
        descriptor(static_cast<size_t>(dim_of(describer.layout())));
    parts_of(scan, rings);
    describer.describe(rings, descriptor);
    return descriptor;
  };
  const PointCloud scan = read_scan(kitti / "sequences/00/velodyne/000052.bin");
  const std::vector<float> still = describe(scan);
  for (const float degrees : {1.0F, 17.3F, 91.7F, -142.2F}) {
    const Eigen::Matrix3f R =
        Eigen::AngleAxisf(degrees * std::numbers::pi_v<float> / 180, Eigen::Vector3f::UnitZ())
            .toRotationMatrix();
    const RingMatch match = match_rings(still, describe(rotated(scan, R)), describer.layout());
    EXPECT_GT(match.similarity, 0.94) << degrees;
    EXPECT_NEAR(std::remainder(match.relative_yaw + degrees * kTurn / 360, kTurn), 0, kTurn / 720);
  }
}

/// Equivalent to `revisit eval --feature ring --protocol leave-one-out --exclusion none`.
void expect_every_place_found(const std::filesystem::path& kitti, const RingModel& model,
                              const engine::Net& net) {
  const Dataset dataset = open_dataset(kitti, "00", true);
  const FeatureExtractor extractor = ring_recognizer(model, net, {});
  const TempDir folder;
  const Observer nobody;
  DatasetFeatures features(dataset, extractor, {.align = AlignCase::kNone, .threads = 2},
                           folder.path(), nobody);
  std::vector<int64_t> all;
  for (int64_t row = 0; row < features.n(); ++row) all.push_back(row);
  const Projection basis = extractor.fit_projection(features.file().rows(), all);
  FloatMatrix descriptors(features.n(), basis.dim);
  for (const int64_t row : all) basis.describe(features.file().row(row), descriptors.row(row));
  const auto near = find_near_pairs(dataset, all, 5, 1 << 20);
  const auto pair_of = [&](int64_t a, int64_t b) {
    return std::ranges::find_if(near, [&](const RingPair& pair) {
      return (pair.a == a && pair.b == b) || (pair.a == b && pair.b == a);
    });
  };
  int found = 0;
  std::vector<double> errors;
  std::vector<double> similarities(all.size());
  for (const int64_t query : all) {
    basis.comparison.similarity(descriptors.row(query), test::rows_of(descriptors, all),
                                similarities);
    double best_right = -1, best_wrong = -1;
    int64_t best = -1;
    for (const int64_t other : all) {
      if (other == query) continue;
      double& of_kind = pair_of(query, other) != near.end() ? best_right : best_wrong;
      of_kind = std::max(of_kind, similarities[static_cast<size_t>(other)]);
      if (best < 0 ||
          similarities[static_cast<size_t>(other)] > similarities[static_cast<size_t>(best)])
        best = other;
    }
    if (best_right < 0) continue;  // 850 was seen once
    EXPECT_GE(best_right, 1.6 * best_wrong) << dataset.scans[static_cast<size_t>(query)].frame;
    const auto pair = pair_of(query, best);
    found += pair != near.end();
    if (pair == near.end()) continue;
    const double turn =
        basis.comparison.relative_yaw(descriptors.row(pair->a), descriptors.row(pair->b));
    errors.push_back(std::abs(std::remainder(turn - pair->relative_yaw, kTurn)));
  }
  EXPECT_EQ(found, 11);
  std::ranges::sort(errors);
  EXPECT_LT(errors[errors.size() / 2], kTurn / 360);
}

TEST(RingFeatures, OnRealScansEveryPlaceIsFound) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  const RingModel model = shipped_ring_model("hdl64");
  expect_every_place_found(kitti, model, ring_net(model));
}

TEST(RingFeatures, OfATrainedNetworkFindEveryPlace) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  REVISIT_NEED_SHARED(weights, "data/caffemodels/squeezenet_v1.0/weights.caffemodel");
  const RingModel model = shipped_ring_model("hdl64", kSqueezeNet);
  expect_every_place_found(kitti, model, ring_net(model, weights));
}

TEST(ShippedRings, ACalibrationIsOfTheUsualOptionsAndNoPartOfAMapsBasis) {
  RingModel model = shipped_ring_model("vlp16");
  model.calibration.reset();
  const engine::Net net = ring_net(model);
  const FeatureExtractor without = ring_recognizer(model, net, {});
  EXPECT_FALSE(without.calibration);
  model.calibration.emplace();
  model.calibration->blocks = {{0.1, 50, 0}, {0.6, 900, 899}};
  const FeatureExtractor rings = ring_recognizer(model, net, {});
  EXPECT_EQ(rings.calibration, model.calibration);
  EXPECT_FALSE(ring_recognizer(model, net, {.blend = 0.5}).calibration);
  EXPECT_EQ(rings.key, without.key);
  FloatMatrix features(3, model.dim());
  for (size_t i = 0; i < features.values.size(); ++i)
    features.values[i] = static_cast<float>(i % 7);
  const std::vector<int64_t> all = {0, 1, 2};
  EXPECT_EQ(rings.fit_projection(features.rows(), all).content,
            without.fit_projection(features.rows(), all).content);
}

}  // namespace
}  // namespace revisit
