#include "revisit/weights_conversion/known_models.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "caffe_schema.pb.h"
#include "revisit/base/error.h"
#include "revisit/weights_conversion/trunks.h"

namespace {

using namespace revisit;

TEST(KnownModels, EntriesAreComplete) {
  std::set<std::string> names, sums;
  for (const models::KnownModel& model : models::known_models()) {
    SCOPED_TRACE(model.name);
    EXPECT_TRUE(names.insert(model.name).second) << "twice";
    EXPECT_FALSE(model.file.empty());
    EXPECT_FALSE(model.licence.empty());
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

TEST(KnownModels, CutsAreLayersOfTheTrunk) {
  for (const models::KnownModel& model : models::known_models()) {
    if (model.trunk.empty()) continue;
    const caffe::NetParameter net = models::trunk(model.trunk);
    std::set<std::string> layers{""};
    for (const auto& layer : net.layer()) layers.insert(layer.name());
    for (const models::Cut& cut : model.cuts) {
      EXPECT_TRUE(layers.contains(cut.end)) << model.name << ": " << cut.end;
      EXPECT_TRUE(layers.contains(cut.graft)) << model.name << ": " << cut.graft;
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
    std::vector<std::string> cuts;
    for (const models::Cut& cut : models::known_model(name).cuts)
      cuts.push_back(models::to_string(cut));
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

TEST(KnownModels, CutsReadAsInThePaper) {
  EXPECT_EQ(models::to_string(models::Cut{"conv3", "pool5"}), "conv3+pool5");
  EXPECT_EQ(models::to_string(models::Cut{"pool5", ""}), "pool5");
}

}  // namespace
