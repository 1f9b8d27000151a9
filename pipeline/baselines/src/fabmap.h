#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "revisit/datasets/describe.h"
#include "revisit/recognition/matrix.h"
#include "revisit/recognition/range_image.h"

namespace revisit {

// FAB-MAP on binary rows `[images][words]`.

/// Chow-Liu tree (1968) of word dependencies, estimated from training images.
struct ChowLiuTree {
  std::vector<int> parent;                          // [words], -1 at the root
  std::vector<double> marginal;                     // [words], p(z = 1)
  std::vector<std::array<double, 2>> given_parent;  // [words], p(z = 1 | parent's z = 0, 1)
};

/// Maximum spanning tree by mutual information. One pseudo-image, spread evenly over the four pairs
/// of values, keeps probabilities off 0 and 1. Throws UsageError without input.
ChowLiuTree chow_liu_tree(const FloatMatrix& images);

struct FabMapOptions {
  double p_detected_if_present = 0.39;  // p(z = 1 | e = 1) of the detector; e: the word is present
  double p_detected_if_absent = 0;      // p(z = 1 | e = 0)
  double p_new_place = 0.9;             // prior of a place that is not a candidate
  double smoothing = 0.99;              // sigma; 1: none
};

class FabMap {
 public:
  /// With `samples` (images of other places) the likelihood of a new place is their mean, else that
  /// of the average place.
  FabMap(const ChowLiuTree& tree, const FabMapOptions& options, const FloatMatrix& samples = {});

  int words() const { return static_cast<int>(terms_.size()); }
  /// ln p(Z | L) of the words `seen` at a place observed once as `place`.
  double log_likelihood(std::span<const float> seen, std::span<const float> place) const;
  /// ln p(Z | new place).
  double log_likelihood_of_new_place(std::span<const float> seen) const;

  /// p(L | Z) of each place; the remainder to 1 is the new place. The prior is uniform over places
  /// (no motion model). Against overconfidence, likelihoods are normalized and smoothed: sigma p +
  /// (1 - sigma) / (places + 1). A Comparison::similarity.
  void posterior(std::span<const float> seen, std::span<const std::span<const float>> places,
                 std::span<double> probabilities) const;

 private:
  /// ln p(z | parent's z, place) of one word, [z][parent's z].
  using Table = std::array<std::array<double, 2>, 2>;
  struct WordTerms {
    int parent = -1;
    std::array<Table, 2> place;  // the place was stored without, with the word
    Table average;               // at the average place
  };
  double term(const Table& table, size_t word, std::span<const float> seen) const;

  FabMapOptions options_;
  std::vector<WordTerms> terms_;  // [words]
  FloatMatrix samples_;
};

struct TrainingOptions {
  int words = 400;
  int images = 400;              // training images, evenly spaced
  int64_t descriptors = 60'000;  // clustered, evenly spaced over those images
  uint64_t seed = 1;
  int threads = 1;
  Observer observer = {};
};

struct WordModel {
  FloatMatrix vocabulary;  // [words][128]
  FloatMatrix images;      // [images][words], for the Chow-Liu tree
  std::string key;         // identifies the training data and options
};
WordModel train_vocabulary(const Dataset& images, const TrainingOptions& options,
                           const std::filesystem::path& folder);
FeatureExtractor word_features(const WordModel& model, bool sampled);

// These functions throw UsageError in a build without OpenCV.

/// The strongest kMaxKeypoints SIFT descriptors (Lowe 2004; OpenCV's defaults), [keypoints][128].
FloatMatrix sift_descriptors(const GrayImage& image);
inline constexpr int kMaxKeypoints = 3000;  // bounds memory; a KITTI image has 1000 to 2000

/// Cluster centers by k-means++, at most 30 iterations. Throws InputError for too few descriptors.
FloatMatrix cluster_words(const FloatMatrix& descriptors, int words, uint64_t seed = 1);

/// `seen[w]` is 1 if w is the nearest word of at least one descriptor, else 0.
void find_words(const FloatMatrix& descriptors, const FloatMatrix& vocabulary,
                std::span<float> seen);

}  // namespace revisit
