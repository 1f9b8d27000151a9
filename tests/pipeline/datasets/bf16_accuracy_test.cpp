// Figures: docs/reference/ACCURACY.md.
#include "float_matrix.h"
#include "revisit/datasets/describe.h"
#include "revisit/engine/net.h"
#include "revisit/evaluation/descriptors.h"
#include "revisit/evaluation/precision_recall.h"
#include "revisit/recognition/feature_file.h"
#include "testing.h"

namespace revisit {
namespace {

TEST(Bf16Accuracy, DescriptorsOfRealScansStayAndSoDoTheirMatches) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  REVISIT_NEED_SHARED(model, "data/caffemodels/squeezenet_v1.0");
  const Dataset dataset = open_dataset(kitti, "00", true);
  const TempDir folder;
  const engine::Net net = engine::Net::load(model / "deploy.prototxt", model / "weights.caffemodel",
                                            {.end = "fire8/concat"});
  const DescribeOptions options{.align = AlignCase::kOne, .threads = 2};
  const auto features_in = [&](engine::Precision precision) {
    const FeatureExtractor feature =
        network_features(net, "squeezenet_v1.0", {104, 117, 123}, {}, {.precision = precision});
    const Observer observer;
    DatasetFeatures features(dataset, feature, options, folder.path(), observer);
    features.file();
    return FeatureFile(features.path());
  };
  const FeatureFile float32 = features_in(engine::Precision::kFloat32),
                    bf16 = features_in(engine::Precision::kBf16);
  const fs::path pca = folder.path() / "pca";
  const FloatMatrix wanted = fit_pca({&float32}, {.model_folder = pca}).descriptors;
  const FloatMatrix found = PcaModel(pca).project({&bf16});
  ASSERT_EQ(found.n, 12);
  double least_of_features = 1, least_of_descriptors = 1;
  for (int64_t i = 0; i < found.n; ++i) {
    least_of_features = std::min(least_of_features, test::cosine_of(float32.row(i), bf16.row(i)));
    least_of_descriptors =
        std::min(least_of_descriptors, test::cosine_of(wanted.row(i), found.row(i)));
  }
  EXPECT_GE(least_of_features, 0.998);
  EXPECT_GE(least_of_descriptors, 0.9995);
  RecordProperty("features", std::to_string(least_of_features));
  RecordProperty("descriptors", std::to_string(least_of_descriptors));
  const Trajectory trajectory = make_trajectory(dataset);
  const Task task = make_tasks("leave-one-out", "00", trajectory, parse_exclusion("none")).at(0);
  const std::vector<Match> a = retrieve({wanted}, task), b = retrieve({found}, task);
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) EXPECT_EQ(a[i].ranks.at(0), b[i].ranks.at(0)) << i;
}

}  // namespace
}  // namespace revisit
