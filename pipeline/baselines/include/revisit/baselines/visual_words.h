#pragma once

#include <filesystem>
#include <functional>

#include "revisit/baselines/fabmap.h"
#include "revisit/datasets/dataset.h"
#include "revisit/datasets/describe.h"
#include "revisit/recognition/gray_image.h"

namespace revisit {

// These functions throw UsageError in a build without OpenCV.

/// The strongest kMaxKeypoints SIFT descriptors (Lowe 2004; OpenCV's defaults), [keypoints][128].
FloatMatrix sift_descriptors(const GrayImage& image);
inline constexpr int kMaxKeypoints = 3000;  // bounds memory; a KITTI image has 1000 to 2000

/// Cluster centers by k-means++, at most 30 iterations. Throws InputError for too few descriptors.
FloatMatrix cluster_words(const FloatMatrix& descriptors, int words, uint64_t seed = 1);

/// `seen[w]` is 1 if w is the nearest word of at least one descriptor, else 0.
void find_words(const FloatMatrix& descriptors, const FloatMatrix& vocabulary,
                std::span<float> seen);

struct TrainingOptions {
  int words = 400;
  int images = 400;              // training images, evenly spaced
  int64_t descriptors = 60'000;  // clustered, evenly spaced over those images
  uint64_t seed = 1;
  int threads = 1;
  std::function<void(int64_t done, int64_t total)> progress;  // [images]
  std::function<bool()> stop;                                 // true: throw Interrupted
};

struct WordModel {
  FloatMatrix vocabulary;  // [words][128]
  FloatMatrix images;      // [images][words], for the Chow-Liu tree
  std::string key;         // identifies the training data and options
};

/// Trains on camera_images(), or loads an equal earlier result from `folder`. The result does not
/// depend on the number of threads. Throws InputError if images cannot be read or show too little,
/// Error if the folder cannot be written, and Interrupted.
WordModel train_vocabulary(const Dataset& images, const TrainingOptions& options,
                           const std::filesystem::path& folder);

/// FAB-MAP: the words of a camera image, compared by the probability of the same place. `sampled`:
/// the likelihood of a new place comes from the training images, which must show other places.
FeatureExtractor fabmap_features(const WordModel& model, const FabMapOptions& options = {},
                                 bool sampled = false);

}  // namespace revisit
