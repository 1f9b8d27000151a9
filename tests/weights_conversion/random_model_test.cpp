#include "revisit/weights_conversion/random_model.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "revisit/base/error.h"
#include "revisit/proto/net_file.h"
#include "revisit/proto/weights_file.h"
#include "revisit/weights_conversion/trunks.h"
#include "test_data.h"

namespace {

using namespace revisit;

// Expected values come from a separate Python program, whose SplitMix64 was verified with the
// published first output for seed 0, e220a8397b1dcdaf.
TEST(RandomModel, BitsAreTheDocumentedOnes) {
  const caffe::NetParameter net = models::random_model("alexnet", 1);
  const auto& conv1 = net.layer(1);
  ASSERT_EQ(conv1.name(), "conv1");
  ASSERT_EQ(conv1.blobs_size(), 2);
  ASSERT_EQ(conv1.blobs(0).data_size(), 96 * 3 * 11 * 11);
  EXPECT_EQ(conv1.blobs(0).data(0), 0x1.33c4fap-5F);
  EXPECT_EQ(conv1.blobs(0).data(1), -0x1.12564ap-6F);
  EXPECT_EQ(conv1.blobs(0).data(2), -0x1.348cf6p-4F);
  EXPECT_EQ(conv1.blobs(0).data(34847), 0x1.19839cp-5F);
  ASSERT_EQ(conv1.blobs(1).data_size(), 96);
  EXPECT_EQ(conv1.blobs(1).data(0), 0x1.b3a1d4p-8F);
  EXPECT_EQ(conv1.blobs(1).data(95), -0x1.8b938cp-9F);
}

/// Moments of the weights of one layer, relative to the expected standard deviation: for n
/// independent Gaussians, mean 0 +- 1/sqrt(n), variance 1 +- sqrt(2/n), kurtosis 3 +- sqrt(24/n).
TEST(RandomModel, WeightsAreGaussianWithHesVariance) {
  const caffe::NetParameter net = models::random_model("alexnet", 42);
  for (const auto& layer : net.layer()) {
    if (layer.type() != "Convolution") continue;
    SCOPED_TRACE(layer.name());
    const auto& blob = layer.blobs(0);
    const double fan_in =
        static_cast<double>(blob.shape().dim(1) * blob.shape().dim(2) * blob.shape().dim(3));
    const double n = blob.data_size();
    double sum = 0, squares = 0, fourths = 0;
    for (const float value : blob.data()) {
      const double x = value / std::sqrt(2 / fan_in);
      sum += x;
      squares += x * x;
      fourths += x * x * x * x;
    }
    EXPECT_NEAR(sum / n, 0, 5 / std::sqrt(n));
    EXPECT_NEAR(squares / n, 1, 5 * std::sqrt(2 / n));
    EXPECT_NEAR(fourths / n, 2.9, 5 * std::sqrt(96 / n));
  }
}

TEST(RandomModel, SeedsAndLayersDiffer) {
  const auto first = models::random_model("vgg_cnn_s", 1),
             second = models::random_model("vgg_cnn_s", 2);
  const auto find = [](const caffe::NetParameter& net,
                       const std::string& name) -> const caffe::BlobProto& {
    for (const auto& layer : net.layer())
      if (layer.name() == name) return layer.blobs(0);
    throw Error("no layer " + name);
  };
  EXPECT_NE(find(first, "conv4").data(0), find(second, "conv4").data(0));
  EXPECT_NE(find(first, "conv4").data(0), find(first, "conv5").data(0));
  EXPECT_EQ(find(first, "conv4").SerializeAsString(),
            find(models::random_model("vgg_cnn_s", 1), "conv4").SerializeAsString());
}

TEST(RandomModel, FilesReadBackAndAreMarkedUntrained) {
  const test::TempDir dir;
  for (const std::string& name : models::trunk_names()) {
    SCOPED_TRACE(name);
    const models::ModelFiles files = models::write_random_model(dir / "new" / name, name, 3);
    const caffe::NetParameter text = proto::read_net(files.prototxt).net;
    EXPECT_TRUE(models::is_untrained(text));
    EXPECT_FALSE(models::is_untrained(models::trunk(name)));

    const auto weights = proto::WeightsFile::open(files.weights);
    const caffe::NetParameter expected = models::random_model(name, 3);
    int convolutions = 0;
    for (size_t l = 0; l < weights->layers().size(); ++l) {
      for (const auto& layer : expected.layer()) {
        if (layer.name() != weights->layers()[l].name || layer.blobs_size() == 0) continue;
        const auto blobs = weights->read(l);
        ASSERT_EQ(blobs.size(), 2U);
        EXPECT_EQ(blobs[0].data,
                  std::vector<float>(layer.blobs(0).data().begin(), layer.blobs(0).data().end()));
        ++convolutions;
      }
    }
    EXPECT_EQ(convolutions,
              std::ranges::count(expected.layer(), "Convolution", &caffe::LayerParameter::type));
  }
}

TEST(RandomModel, SameSeedSameBytes) {
  const test::TempDir dir;
  const auto a = models::write_random_model(dir / "a", "alexnet", 7);
  const auto b = models::write_random_model(dir / "b", "alexnet", 7);
  EXPECT_TRUE(test::read_file(a.weights) == test::read_file(b.weights));
  EXPECT_EQ(test::read_file(a.prototxt), test::read_file(b.prototxt));
}

}  // namespace
