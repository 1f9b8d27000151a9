#include "revisit/weights_conversion/known_models.h"

#include <google/protobuf/util/message_differencer.h>

#include "revisit/proto/net_file.h"
#include "testing.h"

namespace {

using namespace revisit;

caffe::NetParameter own_net(const std::string& name) {
  return proto::parse_net(models::own_net(name), name).net;
}

TEST(KnownModels, EntriesAreComplete) {
  std::set<std::string> names, sums;
  for (const models::KnownModel& model : models::known_models()) {
    SCOPED_TRACE(model.name);
    EXPECT_TRUE(names.insert(model.name).second) << "twice";
    EXPECT_FALSE(model.file.empty());
    EXPECT_FALSE(model.license.empty());
    EXPECT_FALSE(model.prototxt_address.empty());
    EXPECT_FALSE(model.cuts.empty());
    EXPECT_GT(model.input_size, 0);
    EXPECT_EQ(model.sha1.empty(), model.sha1_source.empty());
    EXPECT_TRUE(model.address.empty() || model.address.starts_with("http")) << model.address;
    EXPECT_TRUE(!model.address.empty() || !model.notes.empty()) << "says nowhere how to get it";
    if (!model.sha1.empty()) {
      EXPECT_EQ(model.sha1.size(), 40U);
      EXPECT_EQ(model.sha1.find_first_not_of("0123456789abcdef"), std::string::npos);
      EXPECT_TRUE(sums.insert(model.sha1).second) << "the sum of another model";
    }
    if (model.mean_bgr) {
      for (const double value : *model.mean_bgr) {
        EXPECT_GT(value, 90);
        EXPECT_LT(value, 130);
      }
    }
  }
}

TEST(KnownModels, CutsAreLayersOfOurNet) {
  for (const models::KnownModel& model : models::known_models()) {
    if (model.own_net.empty()) continue;
    const caffe::NetParameter net = own_net(model.own_net);
    std::set<std::string> layers{""};
    for (const auto& layer : net.layer()) layers.insert(layer.name());
    for (const std::string& cut : model.cuts) {
      const size_t plus = std::min(cut.find('+'), cut.size());
      EXPECT_TRUE(layers.contains(cut.substr(0, plus))) << model.name << ": " << cut;
      EXPECT_TRUE(plus == cut.size() || layers.contains(cut.substr(plus + 1)))
          << model.name << ": " << cut;
    }
  }
}

TEST(KnownModels, TheFirstCutIsTheOneThePaperFindsBest) {
  // "In AlexNet, conv3+pool5 offers the best features, in VGG-CNN-S it is conv4+pool5 and in
  // Places-CNDS-8 it is pool5". The table has all three.
  const std::map<std::string, std::vector<std::string>> paper = {
      {"bvlc_alexnet", {"conv3+pool5", "conv4+pool5", "pool5"}},
      {"vgg_cnn_s", {"conv4+pool5", "conv3+pool5", "pool5"}},
      {"places_cnds8", {"pool5", "pool3+pool5", "pool4+pool5"}}};
  for (const auto& [name, wanted] : paper) {
    const std::vector<std::string>& cuts = models::known_model(name).cuts;
    EXPECT_EQ(cuts.front(), wanted.front()) << name;
    EXPECT_TRUE(std::is_permutation(cuts.begin(), cuts.end(), wanted.begin(), wanted.end()))
        << name;
  }
}

TEST(KnownModels, AreFoundByNameAndSum) {
  EXPECT_EQ(models::known_model("VGG_CNN_S").name, "vgg_cnn_s");
  EXPECT_EQ(models::known_model_by_sha1("9116a64c0fbe4459d18f4bb6b56d647b63920377")->name,
            "bvlc_alexnet");
  EXPECT_EQ(models::known_model_by_sha1(""), nullptr);
  EXPECT_EQ(models::known_model_by_sha1(std::string(40, '0')), nullptr);
  EXPECT_THROW(models::known_model("alexnet2"), UsageError);
}

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
  const char* net;
  const char* prototxt;  // in the shared data
};

class OwnNetIsTheOriginal : public testing::TestWithParam<Original> {};

TEST_P(OwnNetIsTheOriginal, UpToPool5) {
  REVISIT_NEED_SHARED(file, std::string("data/nets/") + GetParam().prototxt);
  const caffe::NetParameter original = proto::read_net(file).net;
  const caffe::NetParameter ours = own_net(GetParam().net);
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

INSTANTIATE_TEST_SUITE_P(All, OwnNetIsTheOriginal,
                         testing::Values(Original{"alexnet", "bvlc_alexnet_deploy.prototxt"},
                                         Original{"caffenet",
                                                  "bvlc_reference_caffenet_deploy.prototxt"},
                                         Original{"vgg_cnn_s", "VGG_CNN_S_deploy.prototxt"},
                                         Original{"places_cnds8", "places_cnds8_deploy.prototxt"}),
                         [](const auto& instance) { return std::string(instance.param.net); });

TEST(OwnNets, AlexNetAsInThePaperOfKrizhevsky) {
  const caffe::NetParameter net = own_net("alexnet");
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

TEST(OwnNets, AreFoundByName) {
  EXPECT_EQ(models::own_net_names().size(), 7U);
  EXPECT_EQ(models::own_net("alexnt"), nullptr);
  for (const char* ring : {"ring16", "ring64"})
    EXPECT_EQ(own_net(ring).layer(0).input_param().shape(0).dim(3), 1280) << ring;
}

}  // namespace
