#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "revisit/engine/net.h"
#include "revisit/pipeline/align.h"
#include "revisit/pipeline/dataset.h"
#include "revisit/pipeline/gray_image.h"
#include "revisit/pipeline/range_image.h"
#include "revisit/pipeline/similarity.h"

namespace revisit::pipeline {

/// Writes the feature of one input; the span has FeatureExtractor::dim floats.
template <class Input>
using FeatureFunction = std::function<void(const Input&, std::span<float>)>;
/// Makes a function with its own working memory: one per thread.
template <class Input>
using FeatureMaker = std::function<FeatureFunction<Input>()>;

/// A way to turn scans into feature vectors.
struct FeatureExtractor {
  std::string name;  // for people and plots: "conv3+pool5", "data"
  std::string key;   // names everything the values depend on besides the input
  int64_t dim = 0;
  /// What the feature sees of a scan: the range image of its aligned points, the aligned points
  /// themselves, or the camera image of the same moment.
  std::variant<FeatureMaker<RangeImage>, FeatureMaker<PointCloud>, FeatureMaker<GrayImage>> make;
  Similarity similarity;  // how two of them are compared; empty: cosine

  template <class Input>
  bool sees() const {
    return std::holds_alternative<FeatureMaker<Input>>(make);
  }
};

/// The output of a network, flattened. The gray image is given to every input channel, minus that
/// channel's mean (`mean_bgr`, in pixel values; paper section III-C; a net of one channel gets the
/// mean of the gray image, 0.114 B + 0.587 G + 0.299 R), times `input_scale`; where a convolution
/// sees it first, it is given once and stands for all channels. `net_key` identifies the weights,
/// `threads` are those of one forward pass. Throws InputError when the net has not one input of 1
/// or 3 channels, or cannot take the image size, and UsageError when it has not exactly one output.
FeatureExtractor network_features(const engine::Net& net, const std::string& net_key,
                                  const std::array<double, 3>& mean_bgr,
                                  const ImageGeometry& geometry, int threads = 1,
                                  double input_scale = 1);

/// The range image itself as a vector: the paper's `data`, for comparison.
FeatureExtractor range_vector_features(const ImageGeometry& geometry);

/// How scans are turned before they are projected.
enum class AlignMode { kNone, kCase1, kCase2 };
/// "none", "case1", "case2"; throws UsageError for anything else.
AlignMode parse_align_mode(const std::string& text);
const char* name_of(AlignMode mode);

/// The range image the features see: aligned, projected, holes closed.
RangeImage scan_to_image(const PointCloud& cloud, AlignMode mode, const ImageGeometry& geometry);

struct DescribeOptions {
  ImageGeometry geometry;
  AlignMode align = AlignMode::kCase1;
  /// Scans in flight, one thread each. The values do not depend on it.
  int threads = 1;
  /// A scan that cannot be described (its file is cut off, it holds too few points ...) ends the
  /// work. Otherwise it is left out: its feature is all zero, AlignmentRecord::described says so.
  bool strict = false;
  std::function<void(const ScanRef& scan, const std::string& why)> left_out;  // of each, in order
  std::function<void(const std::string& file)> damaged;       // a finished file that is made anew
  std::function<void(int64_t done, int64_t total)> progress;  // in scans
  std::function<bool()> stop;                                 // true: throw Interrupted
};

/// Milliseconds of one thread for each scan described in this process, by stage; empty for a stage
/// that the feature does not have. (Scans kept from an earlier run are not in it.)
struct DescribeTimes {
  std::vector<double> read, align, project, close, feature, write;
  double wall_ms = 0;  // of all of them, all threads together
  /// Processor time of the describing thread from points (or camera image) in memory to the
  /// feature: unlike the others it does not grow when the machine has other work to do.
  std::vector<double> processor;

  void append(const DescribeTimes& more);
};

/// What one scan's alignment was and how much of it the range image holds, as write_features()
/// stores it: a row of 6 floats. Those of the alignment are NaN when there was no scan but only a
/// camera image, when a scan that is taken as it is has no principal direction, and when the scan
/// was left out.
struct AlignmentRecord {
  float yaw = 0;               // [rad], Alignment::yaw
  float eigenvalue_ratio = 0;  // Alignment::eigenvalue_ratio
  float abs_t11 = 0;           // Alignment::abs_t11
  float mirrored_choice = 0;   // 0 or 1
  float outside = 0;           // Projected::outside_share(); NaN without a range image
  float described = 1;         // 0: the scan could not be described, its feature is all zero
};

/// Where the features of a data set are: `folder/NAME-HASH.npy`, the hash being of everything they
/// depend on: the version of our code, scans (path, size, number and times of change of the file),
/// extractor, geometry and alignment.
struct FeaturePaths {
  std::filesystem::path features;    // [n][dim]
  std::filesystem::path alignments;  // [n][6], AlignmentRecord
  std::string key;
};
FeaturePaths feature_paths(const std::filesystem::path& folder, const Dataset& dataset,
                           const FeatureExtractor& extractor, const DescribeOptions& options);

/// Describes every scan into `paths` (for a feature that sees camera images, `dataset` is one of
/// camera_images()), continuing what an earlier call left. Does nothing when the
/// files are complete; one that is damaged is made anew. Throws Interrupted (what was done is
/// kept), InputError naming a scan whose file cannot be read (with `strict`, one that cannot be
/// described), Error when the disk is full.
DescribeTimes write_features(const FeaturePaths& paths, const Dataset& dataset,
                             const FeatureExtractor& extractor, const DescribeOptions& options);

/// The alignment rows that write_features() stored. Throws InputError.
std::vector<AlignmentRecord> read_alignments(const std::filesystem::path& file);

}  // namespace revisit::pipeline
