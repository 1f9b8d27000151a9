#include "revisit/baselines/baselines.h"
#include "testing.h"

#ifdef REVISIT_HAVE_PCL
#include <pcl/features/esf.h>
#include <pcl/features/grsd.h>
#include <pcl/features/normal_3d.h>
#include <pcl/features/vfh.h>
#include <pcl/search/kdtree.h>
#endif

namespace revisit {
namespace {

#ifdef REVISIT_HAVE_PCL

/// A room 4 x 3 x 2 m with a column, seen from inside; points 2 to 4 cm apart, 1 mm of noise.
PointCloud room(unsigned seed = 1, float column = 0.2F) {
  std::mt19937 random(seed);
  std::normal_distribution<float> noise(0, 0.001F);
  PointCloud cloud;
  const auto add = [&](float x, float y, float z) {
    cloud.points.push_back({x + noise(random), y + noise(random), z + noise(random), 0});
  };
  for (float x = -1; x < 3; x += 0.03F)
    for (float y = -1; y < 2; y += 0.03F) add(x, y, -1);
  for (float x = -1; x < 3; x += 0.03F)
    for (float z = -1; z < 1; z += 0.03F) add(x, 2, z);
  for (float y = -1; y < 2; y += 0.03F)
    for (float z = -1; z < 1; z += 0.03F) add(3, y, z);
  for (float a = 0; a < 2 * std::numbers::pi_v<float>; a += 0.02F / column)
    for (float z = -1; z < 1; z += 0.03F)
      add(1.5F + column * std::cos(a), 0.5F + column * std::sin(a), z);
  return cloud;
}

std::vector<float> describe(const FeatureExtractor& extractor, const PointCloud& cloud) {
  std::vector<float> feature(static_cast<size_t>(extractor.dim), -1);
  std::get<FeatureMaker<PointCloud>>(extractor.make)()(cloud, feature);
  return feature;
}

double cosine_of(const std::vector<float>& a, const std::vector<float>& b) {
  const auto dot = [](const auto& x, const auto& y) {
    return std::inner_product(x.begin(), x.end(), y.begin(), 0.0);
  };
  return dot(a, b) / std::sqrt(dot(a, a) * dot(b, b));
}

/// PCL's descriptors, for points that all have a normal.
struct Pcl {
  explicit Pcl(const PointCloud& cloud, double normal_radius) {
    for (const Point& p : cloud.points) points->push_back({p.x, p.y, p.z});
    pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
    estimation.setInputCloud(points);
    estimation.setRadiusSearch(normal_radius);
    estimation.compute(*normals);
    for (const pcl::Normal& normal : *normals) EXPECT_TRUE(std::isfinite(normal.normal_x));
  }
  template <class Estimation, class Signature>
  std::vector<float> run(Estimation& estimation, Signature) const {
    estimation.setInputCloud(points);
    pcl::PointCloud<Signature> signature;
    estimation.compute(signature);
    const auto* begin = signature.at(0).histogram;
    return {begin, begin + Signature::descriptorSize()};
  }

  pcl::PointCloud<pcl::PointXYZ>::Ptr points{new pcl::PointCloud<pcl::PointXYZ>};
  pcl::PointCloud<pcl::Normal>::Ptr normals{new pcl::PointCloud<pcl::Normal>};
};

TEST(PclFeatures, VfhIsPcls) {
  const PointCloud cloud = room();
  const Pcl pcl(cloud, 0.1);
  pcl::VFHEstimation<pcl::PointXYZ, pcl::Normal> estimation;
  estimation.setInputNormals(pcl.normals);
  const auto expected = pcl.run(estimation, pcl::VFHSignature308());
  const auto found = describe(vfh_features(0.1), cloud);
  ASSERT_EQ(found.size(), 308U);
  for (size_t i = 0; i < 308; ++i) EXPECT_NEAR(found[i], expected[i], 0.05) << i;  // of 100
}

TEST(PclFeatures, GrsdIsPcls) {
  const PointCloud cloud = room();
  const Pcl pcl(cloud, 0.1);
  pcl::GRSDEstimation<pcl::PointXYZ, pcl::Normal, pcl::GRSDSignature21> estimation;
  estimation.setInputNormals(pcl.normals);
  estimation.setRadiusSearch(0.1);
  const auto expected = pcl.run(estimation, pcl::GRSDSignature21());
  const auto found = describe(grsd_features(0.1, 0.1), cloud);
  ASSERT_EQ(found.size(), 21U);
  EXPECT_EQ(std::accumulate(found.begin(), found.end(), 0.0),
            std::accumulate(expected.begin(), expected.end(), 0.0));
  // PCL sums a voxel's points in another order: two voxels at the border of a class may change it.
  for (size_t i = 0; i < 21; ++i) EXPECT_NEAR(found[i], expected[i], 2 * 26) << i;
}

TEST(PclFeatures, EsfIsPclsUpToTheDraws) {
  const PointCloud cloud = room();
  const Pcl pcl(cloud, 0.1);
  pcl::ESFEstimation<pcl::PointXYZ> estimation;
  const auto expected = pcl.run(estimation, pcl::ESFSignature640());
  const auto found = describe(esf_features(), cloud);
  ASSERT_EQ(found.size(), 640U);
  EXPECT_NEAR(std::accumulate(found.begin(), found.end(), 0.0), 1, 1e-4);
  // 20,000 triangles: each histogram of 64 bins has its fraction within 0.02. The total difference
  // is about that of two draws of PCL, which takes its seed from the time.
  for (size_t h = 0; h < 10; ++h) {
    const auto share = [&](const std::vector<float>& all) {
      return std::accumulate(all.begin() + h * 64, all.begin() + (h + 1) * 64, 0.0);
    };
    EXPECT_NEAR(share(found), share(expected), 0.02) << h;
  }
  EXPECT_GT(cosine_of(found, expected), 0.99);
}

TEST(PclFeatures, AnotherRoomIsAnotherDescriptor) {
  for (const FeatureExtractor& extractor :
       {vfh_features(0.1), esf_features(), grsd_features(0.1, 0.1)}) {
    const auto same = describe(extractor, room(2)), other = describe(extractor, room(3, 0.9F));
    EXPECT_GT(cosine_of(describe(extractor, room(1)), same), cosine_of(same, other))
        << extractor.name;
  }
}

TEST(PclFeatures, OneScanHasOneDescriptor) {
  const FeatureExtractor esf = esf_features();
  const auto first = describe(esf, room(1));
  describe(esf, room(2));
  EXPECT_EQ(describe(esf, room(1)), first);
  const auto function = std::get<FeatureMaker<PointCloud>>(esf.make)();
  std::vector<float> again(640);
  function(room(3), again);
  function(room(1), again);
  EXPECT_EQ(again, first) << "the voxels of the scan before are still there";
}

TEST(PclFeatures, TurningTheSensorDoesNotMatter) {
  // VFH depends on the sensor's position only; voxels of ESF and GRSD follow the axes.
  const PointCloud cloud = room();
  PointCloud turned;
  for (const Point& p : cloud.points)
    turned.points.push_back({0.6F * p.x - 0.8F * p.y, 0.8F * p.x + 0.6F * p.y, p.z, 0});
  const FeatureExtractor vfh = vfh_features(0.1);
  EXPECT_GT(cosine_of(describe(vfh, cloud), describe(vfh, turned)), 0.9999);
}

TEST(PclFeatures, WithoutNormalsAllIsZero) {
  PointCloud sparse;
  for (int i = 0; i < 100; ++i) sparse.points.push_back({static_cast<float>(i), 1, 1, 0});
  for (const FeatureExtractor& extractor : {vfh_features(), grsd_features()}) {
    const auto feature = describe(extractor, sparse);
    EXPECT_TRUE(std::all_of(feature.begin(), feature.end(), [](float x) { return x == 0; }));
    EXPECT_EQ(describe(extractor, {}), feature);
  }
}

TEST(PclFeatures, WideScansNeedLittleMemory) {
  // Two walls 1.9 km apart: 7e9 voxels of 0.1 m, in PCL's array 26 GB.
  PointCloud cloud;
  for (const float x : {-950.0F, 950.0F})
    for (float y = 900; y < 900.8F; y += 0.02F)
      for (float z = 0; z < 0.8F; z += 0.02F) cloud.points.push_back({x, y, z, 0});
  cloud.points.push_back({1e30F, 0, 0, 0});
  cloud.points.push_back({0, -3e5F, 0, 0});
  const auto feature = describe(grsd_features(), cloud);
  EXPECT_GT(*std::max_element(feature.begin(), feature.end()), 0);
}

TEST(PclFeatures, HopelessPointsAreRefused) {
  PointCloud line, dot, dense;
  line.points.assign(50, {1, 0, 0, 0});
  line.points.resize(100, {2, 0, 0, 0});
  dot.points.assign(100, {1, 2, 3, 0});
  dense.points.assign(200'000, {1, 2, 3, 0});
  expect_error<InputError>([&] { describe(esf_features(), line); }, {"collinear"});
  expect_error<InputError>([&] { describe(esf_features(), dot); }, {"equal"});
  expect_error<InputError>([&] { describe(esf_features(), {}); }, {"at least 3 points"});
  expect_error<InputError>([&] { describe(vfh_features(), dense); }, {"too dense", "downsample"});
  expect_error<UsageError>([] { vfh_features(0); }, {"VFH", "radius"});
  expect_error<UsageError>([] { grsd_features(0.05, 1e9); }, {"GRSD", "radius"});
}

#else

TEST(PclFeatures, AbsentPclIsSaid) {
  expect_error<UsageError>([] { vfh_features(); }, {"vfh", "libpcl-dev"});
  expect_error<UsageError>([] { esf_features(); }, {"esf", "libpcl-dev"});
  expect_error<UsageError>([] { grsd_features(); }, {"grsd", "libpcl-dev"});
}

#endif

}  // namespace
}  // namespace revisit
