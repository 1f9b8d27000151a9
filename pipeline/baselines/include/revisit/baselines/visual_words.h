#pragma once

#include <filesystem>
#include <functional>

#include "revisit/baselines/fabmap.h"
#include "revisit/datasets/dataset.h"
#include "revisit/datasets/describe.h"
#include "revisit/recognition/gray_image.h"

namespace revisit::pipeline {

// In a build without OpenCV the functions throw UsageError.

/// The kMostKeypoints strongest SIFT descriptors (Lowe 2004; OpenCV's defaults), [keypoints][128].
FloatMatrix sift_descriptors(const GrayImage& image);
inline constexpr int kMostKeypoints = 3000;  // bounds memory; a KITTI image has 1000 to 2000

/// Centres of k-means++ clusters, at most 30 rounds. Throws InputError for too few descriptors.
FloatMatrix cluster_words(const FloatMatrix& descriptors, int words, uint64_t seed = 1);

/// `seen[w]` is 1 when w is the nearest word of some descriptor, else 0.
void find_words(const FloatMatrix& descriptors, const FloatMatrix& vocabulary,
                std::span<float> seen);

struct TrainingOptions {
  int words = 400;               // of the vocabulary
  int images = 400;              // to learn from, evenly spread over those there are
  int64_t descriptors = 60'000;  // to cluster, evenly spread over those images
  uint64_t seed = 1;
  int threads = 1;
  std::function<void(int64_t done, int64_t total)> progress;  // in images
  std::function<bool()> stop;                                 // true: throw Interrupted
};

/// What FAB-MAP learns before it sees its map.
struct WordModel {
  FloatMatrix vocabulary;  // [words][128]
  FloatMatrix images;      // [images][words], of the training images: words occur together so
  std::string key;         // names everything it was learnt from
};

/// Learns from camera_images(), or takes what an earlier equal call left in `folder`. The result
/// does not depend on the number of threads. Throws InputError for images that cannot be read or
/// show too little, Interrupted, and Error when the folder cannot be written.
WordModel learn_words(const Dataset& images, const TrainingOptions& options,
                      const std::filesystem::path& folder);

/// FAB-MAP: the words of a camera image, compared by the probability of one place. `sampled` takes
/// the likelihood of a new place from the training images, which must be of other places.
FeatureExtractor fabmap_features(const WordModel& model, const FabMapOptions& options = {},
                                 bool sampled = false);

}  // namespace revisit::pipeline
