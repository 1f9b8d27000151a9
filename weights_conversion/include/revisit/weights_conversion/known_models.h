#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace revisit::models {

/// The feature is the output of `end` (after an in-place ReLU, if grafted), then a copy of `graft`.
struct Cut {
  std::string end, graft;
};

/// "conv3+pool5", or "pool5" without a graft.
std::string to_string(const Cut& cut);

/// A pretrained network of the Caffe community: where it is to be had and how to use it.
struct KnownModel {
  std::string name{};         // as in `revisit models fetch NAME`
  std::string address{};      // of the weights, or of an archive; "" when none is known
  std::string file{};         // its name in the cache: <cache>/<name>/<file>
  std::string sha1{};         // lower-case hexadecimal; "" when nobody published it
  std::string sha1_source{};  // where it is stated; "" without sha1
  /// The sum is of one third party only: a file that has another may be the real one.
  bool sha1_is_doubtful = false;
  std::string licence{};
  std::optional<std::array<double, 3>> mean_bgr{};  // to be subtracted, in 0..255; absent: unknown
  int input_size = 0;                               // [pixel] height and width it was trained with
  std::vector<Cut> cuts{};         // suggested; first the one that the paper finds best
  std::string trunk{};             // our own description (trunks.h) that fits it; "" when none does
  std::string prototxt_address{};  // where its authors publish the description
  bool needs_browser = false;      // the address gives a web page, not the file
  std::string notes{};
};

/// The table, in the order of preference for place recognition (the paper's networks first).
const std::vector<KnownModel>& known_models();
std::vector<std::string> known_model_names();

/// The entry called `name`, without regard to case. Throws UsageError with the nearest name.
const KnownModel& known_model(const std::string& name);

/// The entry whose published sum is `sha1`, or null.
const KnownModel* known_model_by_sha1(const std::string& sha1);

/// BGR mean of the ILSVRC 2012 training images in 0..255, the usual choice when a model's own is
/// not known. Source: imagenet_mean.binaryproto of caffe_ilsvrc12.tar.gz.
inline constexpr std::array<double, 3> kIlsvrcMeanBgr = {104.007, 116.669, 122.679};

}  // namespace revisit::models
