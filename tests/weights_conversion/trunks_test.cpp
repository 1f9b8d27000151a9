#include "revisit/weights_conversion/trunks.h"

#include <google/protobuf/util/message_differencer.h>
#include <gtest/gtest.h>

#include "revisit/base/error.h"
#include "revisit/proto/net_file.h"
#include "test_data.h"

namespace {

using namespace revisit;

/// Removes fields for training and for other engines.
caffe::LayerParameter essence(caffe::LayerParameter layer) {
  layer.clear_param();
  layer.clear_blobs();
  if (layer.has_convolution_param()) {
    layer.mutable_convolution_param()->clear_weight_filler();
    layer.mutable_convolution_param()->clear_bias_filler();
  }
  if (layer.type() == "Input") {  // upgraded files have another name and batch size
    layer.clear_name();
    layer.clear_input_param();
  }
  return layer;
}

struct Original {
  const char* trunk;
  const char* prototxt;  // in the shared data
};

class TrunkIsTheOriginal : public testing::TestWithParam<Original> {};

TEST_P(TrunkIsTheOriginal, UpToPool5) {
  REVISIT_NEED_SHARED(file, std::string("data/nets/") + GetParam().prototxt);
  const caffe::NetParameter original = proto::read_net(file).net;
  const caffe::NetParameter ours = models::trunk(GetParam().trunk);
  ASSERT_LT(ours.layer_size(), original.layer_size());
  ASSERT_EQ(ours.layer(ours.layer_size() - 1).name(), "pool5");
  google::protobuf::util::MessageDifferencer differ;
  differ.set_message_field_comparison(google::protobuf::util::MessageDifferencer::EQUIVALENT);
  std::string differences;
  differ.ReportDifferencesToString(&differences);
  for (int l = 0; l < ours.layer_size(); ++l)
    EXPECT_TRUE(differ.Compare(essence(original.layer(l)), essence(ours.layer(l))))
        << "layer " << l << " '" << ours.layer(l).name() << "': " << differences;
  EXPECT_EQ(ours.layer(0).input_param().shape(0).dim(2),
            original.layer(0).input_param().shape(0).dim(2));
}

INSTANTIATE_TEST_SUITE_P(All, TrunkIsTheOriginal,
                         testing::Values(Original{"alexnet", "bvlc_alexnet_deploy.prototxt"},
                                         Original{"caffenet",
                                                  "bvlc_reference_caffenet_deploy.prototxt"},
                                         Original{"vgg_cnn_s", "VGG_CNN_S_deploy.prototxt"},
                                         Original{"places_cnds8", "places_cnds8_deploy.prototxt"}),
                         [](const auto& instance) { return std::string(instance.param.trunk); });

TEST(Trunks, AlexNetAsInThePaperOfKrizhevsky) {
  const caffe::NetParameter net = models::trunk("alexnet");
  std::string names;
  for (const auto& layer : net.layer()) names += layer.name() + " ";
  EXPECT_EQ(names,
            "data conv1 relu1 norm1 pool1 conv2 relu2 norm2 pool2 conv3 relu3 conv4 relu4 conv5 "
            "relu5 pool5 ");
  const auto& conv2 = net.layer(5).convolution_param();
  EXPECT_EQ(conv2.num_output(), 256U);
  EXPECT_EQ(conv2.group(), 2U);
  EXPECT_EQ(conv2.pad(0), 2U);
}

TEST(Trunks, UnknownNameNamesTheNearest) {
  try {
    models::trunk("alexnt");
    FAIL() << "no error";
  } catch (const UsageError& error) {
    EXPECT_NE(std::string(error.what()).find("did you mean 'alexnet'"), std::string::npos)
        << error.what();
  }
}

}  // namespace
