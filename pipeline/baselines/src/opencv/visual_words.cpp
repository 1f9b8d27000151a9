#include <algorithm>
#include <mutex>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>

#include "fabmap.h"
#include "revisit/base/error.h"
#include "revisit/baselines/baselines.h"

namespace revisit {
namespace {

constexpr int kSiftDim = 128;

/// OpenCV has no views of constant data: callers must not write to these.
cv::Mat view_of(const GrayImage& image) {
  return {image.height, image.width, CV_8U, const_cast<uint8_t*>(image.pixels.data())};
}
cv::Mat view_of(const FloatMatrix& matrix) {
  return {static_cast<int>(matrix.n), static_cast<int>(matrix.d), CV_32F,
          const_cast<float*>(matrix.values.data())};
}

FloatMatrix copy_of(const cv::Mat& matrix, int columns) {
  FloatMatrix copy(matrix.rows, columns);
  for (int row = 0; row < matrix.rows; ++row)
    std::copy_n(matrix.ptr<float>(row), columns, copy.row(row).begin());
  return copy;
}

/// Images are described in parallel, one thread each. Set once per process, because the call
/// destroys OpenCV's thread pool, which other threads may be using.
void use_one_thread() {
  static std::once_flag once;
  std::call_once(once, [] { cv::setNumThreads(1); });
}

}  // namespace

FloatMatrix sift_descriptors(const GrayImage& image) {
  use_one_thread();
  std::vector<cv::KeyPoint> keypoints;
  cv::Mat descriptors;
  cv::SIFT::create(kMaxKeypoints)
      ->detectAndCompute(view_of(image), cv::noArray(), keypoints, descriptors);
  return copy_of(descriptors, kSiftDim);
}

FloatMatrix cluster_words(const FloatMatrix& descriptors, int words, uint64_t seed) {
  if (words < 1) throw UsageError("vocabulary: expected at least 1 word, found ", words);
  if (descriptors.n < words)
    throw InputError("the training images show ", descriptors.n, " SIFT descriptors, too few for ",
                     words, " words; use more images, or images with more texture");
  constexpr int kRounds = 30, kAttempts = 1;
  cv::theRNG().state = seed;  // the calling thread's
  cv::Mat labels, centers;
  cv::kmeans(view_of(descriptors), words, labels,
             cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, kRounds, 1e-3),
             kAttempts, cv::KMEANS_PP_CENTERS, centers);
  return copy_of(centers, static_cast<int>(descriptors.d));
}

void find_words(const FloatMatrix& descriptors, const FloatMatrix& vocabulary,
                std::span<float> seen) {
  std::fill(seen.begin(), seen.end(), 0.0F);
  if (descriptors.n == 0) return;
  std::vector<cv::DMatch> nearest;
  cv::BFMatcher(cv::NORM_L2).match(view_of(descriptors), view_of(vocabulary), nearest);
  for (const cv::DMatch& match : nearest) seen[static_cast<size_t>(match.trainIdx)] = 1;
}

}  // namespace revisit
