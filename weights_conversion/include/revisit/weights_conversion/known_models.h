#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace revisit::models {

/// A published Caffe model.
struct KnownModel {
  std::string name{};         ///< argument of `revisit models fetch`
  std::string address{};      ///< URL of the weights or of an archive; "" if unknown
  std::string file{};         ///< name in the cache: CACHE/name/file
  std::string sha1{};         ///< lower-case hexadecimal; "" if not published
  std::string sha1_source{};  ///< publication of the SHA-1; "" without sha1
  /// The SHA-1 has a single third-party source, so a file with another one may be the original.
  bool sha1_is_doubtful = false;
  std::string license{};  ///< of the weights, as published
  std::optional<std::array<double, 3>>
      mean_bgr{};      ///< mean to subtract, in 0..255; absent: unknown
  int input_size = 0;  ///< height and width in training [pixels]
  /// Suggested truncations; the paper's best first. "pool5": the feature is the output of this
  /// layer; "conv3+pool5": of conv3, after its in-place ReLU, followed by a copy of pool5.
  std::vector<std::string> cuts{};
  std::string own_net{};           ///< name of own_net(); "" if none
  std::string prototxt_address{};  ///< URL of the original net; "" if unknown
  bool needs_browser = false;      ///< the URL is a web page instead of the file
  std::string notes{};             ///< what a user should know, for display
};

/// Returns the table in the order of preference for place recognition (the paper's networks first).
const std::vector<KnownModel>& known_models();
std::vector<std::string> known_model_names();  ///< in the same order

/// Returns the entry with this name, case-insensitively. Throws UsageError with the closest name.
const KnownModel& known_model(const std::string& name);

/// Returns null for an unknown SHA-1.
const KnownModel* known_model_by_sha1(const std::string& sha1);

/// BGR mean of the ILSVRC 2012 training images in 0..255, the usual default if a model's mean is
/// unknown. Source: imagenet_mean.binaryproto of caffe_ilsvrc12.tar.gz.
inline constexpr std::array<double, 3> kIlsvrcMeanBgr = {104.007, 116.669, 122.679};

/// Content of a prototxt of `weights_conversion/nets/`, without weights. Layers have the original
/// names, so that the original caffemodels match. Inputs have the original size; larger ones work,
/// too. Returns null for an unknown name; names are those of the files, e.g. "alexnet".
const char* own_net(const std::string& name);
std::vector<std::string> own_net_names();  ///< names for own_net()

}  // namespace revisit::models
