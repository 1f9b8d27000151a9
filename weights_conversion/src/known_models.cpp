#include "revisit/weights_conversion/known_models.h"

#include <algorithm>

#include "own_nets.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit::models {
namespace {

constexpr std::array<double, 3> kVggMeanBgr = {102.717, 115.773, 123.509};
constexpr std::array<double, 3> kRoundMeanBgr = {104, 117, 123};

// Checksums come from public sources, because no address could be reached for verification.
// Entries without `file` use the last component of the address.
std::vector<KnownModel> table() {
  // Feature layers of the paper's section on networks and layers, best first.
  const std::vector<std::string> kAlexNetCuts = {"conv3+pool5", "conv4+pool5", "pool5"};
  const std::vector<std::string> kVggCuts = {"conv4+pool5", "conv3+pool5", "pool5"};
  const std::vector<std::string> kPlacesCuts = {"pool5", "pool4+pool5", "pool3+pool5"};
  const char* const kVggNotes = "mean as VGG_CNN_S: one mean image for the whole release";
  const auto bvlc = [](KnownModel model) {
    const std::string folder = str("models/", model.name);
    model.address = str("http://dl.caffe.berkeleyvision.org/", model.name, ".caffemodel");
    model.sha1_source = str(folder, "/readme.md of github.com/BVLC/caffe");
    model.license = "unrestricted";
    model.prototxt_address = str("https://github.com/BVLC/caffe, ", folder, "/deploy.prototxt");
    return model;
  };
  const auto places = [&](const char* name, const char* archive) {
    return KnownModel{
        .name = name,
        .address = str("http://places.csail.mit.edu/model/", archive, "_upgraded.tar.gz"),
        .license = "not stated; see places.csail.mit.edu",
        .input_size = 227,
        .cuts = kAlexNetCuts,
        .prototxt_address = "in the archive",
        .notes = "archive with prototxt, weights and mean image"};
  };
  const auto vgg = [](KnownModel model, const char* gist) {
    model.address =
        "http://www.robots.ox.ac.uk/~vgg/software/deep_eval/releases/bvlc/" + model.file;
    model.license = "non-commercial";
    model.mean_bgr = kVggMeanBgr;
    model.input_size = 224;
    model.prototxt_address = str("https://gist.github.com/ksimonyan/", gist);
    return model;
  };
  return {
      bvlc({.name = "bvlc_alexnet",
            .sha1 = "9116a64c0fbe4459d18f4bb6b56d647b63920377",
            .mean_bgr = kIlsvrcMeanBgr,
            .input_size = 227,
            .cuts = kAlexNetCuts,
            .own_net = "alexnet"}),
      vgg({.name = "vgg_cnn_s",
           .file = "VGG_CNN_S.caffemodel",
           .sha1 = "862b3744bce69b7ba90d29b8099aed3b00c8580b",
           .sha1_source = "one third-party source only",
           .sha1_is_doubtful = true,
           .cuts = kVggCuts,
           .own_net = "vgg_cnn_s",
           .notes = "mean image: VGG_mean.binaryproto in the same folder"},
          "fd8800eeb36e276cd6f9"),
      {.name = "places_cnds8",
       .address = "https://drive.google.com/file/d/0B_s0NuQ5DMW_SUZCOUV2amY3ZkU/view",
       .file = "8conv3fc_CNDS.caffemodel",
       .license = "not stated; cite arXiv:1505.02496",
       .input_size = 227,
       .cuts = kPlacesCuts,
       .own_net = "places_cnds8",
       .prototxt_address = "beside the weights, or with arXiv:1505.02496",
       .needs_browser = true},
      {.name = "squeezenet_v1.0",
       .file = "squeezenet_v1.0.caffemodel",
       .sha1 = "0c5ba9eceae67db71dbfde095d807f4e1006c946",
       .sha1_source = "measured on a copy that names its input classes as expected",
       .license = "BSD",
       .mean_bgr = kRoundMeanBgr,
       .input_size = 227,
       .cuts = {"pool8", "fire6/concat+pool8", "fire5/concat+pool8", "fire8/concat"},
       .prototxt_address = "comes with the copy",
       .notes = "no public address is known for this copy; the layers of DeepScale's release have "
                "other names"},
      bvlc({.name = "bvlc_reference_caffenet",
            .sha1 = "4c8d77deb20ea792f84eb5e6d0a11ca0a8660a46",
            .mean_bgr = kIlsvrcMeanBgr,
            .input_size = 227,
            .cuts = kAlexNetCuts,
            .own_net = "caffenet",
            .notes = "AlexNet with pooling before normalization"}),
      {.name = "squeezenet_v1.1",
       .address = "https://raw.githubusercontent.com/DeepScale/SqueezeNet/"
                  "b5c3f1a23713c8b3fd7b801d229f6b04c64374a5/SqueezeNet_v1.1/"
                  "squeezenet_v1.1.caffemodel",
       .sha1 = "3397f026368a45ae236403ccc81cfcbe8ebe1bd0",
       .sha1_source = "opencv_extra/testdata/dnn/download_models.py",
       .license = "BSD",
       .mean_bgr = kRoundMeanBgr,
       .input_size = 227,
       .cuts = {"pool5", "fire8/concat"},
       .prototxt_address =
           "https://github.com/DeepScale/SqueezeNet, SqueezeNet_v1.1/deploy.prototxt"},
      places("places205_alexnet", "placesCNN"),
      places("hybrid_alexnet", "hybridCNN"),
      vgg({.name = "vgg_cnn_m_2048",
           .file = "VGG_CNN_M_2048.caffemodel",
           .cuts = kAlexNetCuts,
           .notes = kVggNotes},
          "78047f3591446d1d7b91"),
      vgg({.name = "vgg_cnn_f",
           .file = "VGG_CNN_F.caffemodel",
           .cuts = kAlexNetCuts,
           .notes = kVggNotes},
          "a32c9063ec8e1118221a"),
      {.name = "vgg16",
       .address = "http://www.robots.ox.ac.uk/~vgg/software/very_deep/caffe/"
                  "VGG_ILSVRC_16_layers.caffemodel",
       .license = "CC BY (to be confirmed)",
       .mean_bgr = std::array<double, 3>{103.939, 116.779, 123.68},
       .input_size = 224,
       .cuts = {"conv4_3+pool5", "pool5"},
       .prototxt_address = "https://gist.github.com/ksimonyan/211839e770f7b538e2d8"},
      bvlc({.name = "bvlc_googlenet",
            .sha1 = "405fc5acd08a3bb12de8ee5e23a96bec22f08204",
            .mean_bgr = kRoundMeanBgr,
            .input_size = 224,
            .cuts = {"pool4/3x3_s2"}}),
  };
}

}  // namespace

const std::vector<KnownModel>& known_models() {
  static const std::vector<KnownModel> models = [] {
    std::vector<KnownModel> all = table();
    for (KnownModel& model : all)
      if (model.file.empty()) model.file = model.address.substr(model.address.rfind('/') + 1);
    return all;
  }();
  return models;
}

std::vector<std::string> known_model_names() {
  std::vector<std::string> names;
  for (const KnownModel& model : known_models()) names.push_back(model.name);
  return names;
}

const KnownModel& known_model(const std::string& name) {
  for (const KnownModel& model : known_models())
    if (lower(name) == model.name) return model;
  throw UsageError("unknown model '", name, "'",
                   nearest_name_hint(lower(name), known_model_names()),
                   "; known: ", joined(known_model_names(), ", "));
}

const KnownModel* known_model_by_sha1(const std::string& sha1) {
  for (const KnownModel& model : known_models())
    if (!model.sha1.empty() && model.sha1 == sha1) return &model;
  return nullptr;
}

const char* own_net(const std::string& name) {
  const auto* const found = std::ranges::find(kOwnNets, name, &OwnNet::name);
  return found == std::end(kOwnNets) ? nullptr : found->prototxt;
}

std::vector<std::string> own_net_names() {
  std::vector<std::string> names;
  for (const OwnNet& net : kOwnNets) names.emplace_back(net.name);
  return names;
}

}  // namespace revisit::models
