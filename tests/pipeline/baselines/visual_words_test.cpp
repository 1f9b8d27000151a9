#include "fabmap.h"
#include "revisit/baselines/baselines.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/evaluation/descriptors.h"
#include "revisit/evaluation/protocols.h"
#include "revisit/recognition/feature_file.h"
#include "testing.h"

namespace revisit {
namespace {

/// Blobs at random positions; brightness and noise vary as in a second pass.
GrayImage scene(unsigned place, int shift = 0, double gain = 1, unsigned noise = 0) {
  std::mt19937 random(place + 1);
  std::uniform_real_distribution<double> uniform;
  GrayImage image{160, 120, std::vector<uint8_t>(160 * 120, 0)};
  std::vector<double> light(160 * 120, 60);
  for (int blob = 0; blob < 60; ++blob) {
    const double x = 160 * uniform(random) + shift, y = 120 * uniform(random);
    const double across = 2 + 6 * uniform(random), along = 2 + 6 * uniform(random);
    const double bright = 150 * uniform(random) - 50;
    for (int row = std::max(0, static_cast<int>(y - 30));
         row < std::min(120, static_cast<int>(y + 30)); ++row)
      for (int column = std::max(0, static_cast<int>(x - 30));
           column < std::min(160, static_cast<int>(x + 30)); ++column)
        light[row * 160 + column] +=
            bright * std::exp(-std::pow((column - x) / across, 2) - std::pow((row - y) / along, 2));
  }
  std::mt19937 noisy(noise);
  std::normal_distribution<double> normal;
  for (size_t i = 0; i < light.size(); ++i)
    image.pixels[i] = static_cast<uint8_t>(
        std::clamp(gain * light[i] + (noise ? 2 * normal(noisy) : 0), 0.0, 255.0));
  return image;
}

class VisualWords : public testing::Test {
 protected:
  void SetUp() override {
#ifndef REVISIT_HAVE_OPENCV
    GTEST_SKIP() << "built without OpenCV";
#endif
  }
  /// Twelve places, and the first six of them again: shifted, brighter, with noise.
  VisualWords() {
    for (unsigned i = 0; i < 18; ++i) {
      const GrayImage image = i < 12 ? scene(i) : scene(i - 12, 3, 1.1, i);
      const auto file = dir_ / (std::to_string(i) + ".png");
      write_gray_png(file, image);
      images_.scans.push_back({file, static_cast<int>(i), {}, {}});
    }
    options_.words = 60;
  }
  const TempDir dir_;
  Dataset images_;
  TrainingOptions options_;
};

TEST_F(VisualWords, SiftDescribesTexture) {
  const FloatMatrix descriptors = sift_descriptors(scene(1));
  EXPECT_EQ(descriptors.d, 128);
  EXPECT_GT(descriptors.n, 20);
  EXPECT_EQ(sift_descriptors({160, 120, std::vector<uint8_t>(160 * 120, 100)}).n, 0);
  EXPECT_EQ(sift_descriptors({1, 1, {7}}).n, 0);
}

TEST_F(VisualWords, ClustersByHand) {
  FloatMatrix points(6, 2);
  points.values = {0, 0, 0, 2, 10, 10, 10, 12, 50, 0, 52, 0};
  FloatMatrix words = cluster_words(points, 3);
  std::vector<std::pair<float, float>> centers;
  for (int64_t i = 0; i < 3; ++i) centers.emplace_back(words.row(i)[0], words.row(i)[1]);
  std::sort(centers.begin(), centers.end());
  EXPECT_EQ(centers, (std::vector<std::pair<float, float>>{{0, 1}, {10, 11}, {51, 0}}));
  std::vector<float> seen(3);
  FloatMatrix two(2, 2);
  two.values = {11, 9, 12, 12};
  find_words(two, words, seen);
  for (int64_t i = 0; i < 3; ++i) EXPECT_EQ(seen[i], words.row(i)[0] == 10 ? 1 : 0);
  find_words(FloatMatrix(0, 2), words, seen);
  EXPECT_EQ(seen, std::vector<float>(3));
  expect_error<InputError>([&] { cluster_words(points, 7); }, {"6 SIFT descriptors", "7 words"});
}

TEST_F(VisualWords, TrainedWordsAreKept) {
  const WordModel learnt = train_vocabulary(images_, options_, dir_ / "");
  EXPECT_EQ(learnt.vocabulary.n, 60);
  EXPECT_EQ(learnt.images.n, 18);
  for (int64_t i = 0; i < 18; ++i) {
    std::vector<float> seen(60);
    const auto& file = images_.scans[static_cast<size_t>(i)].file;
    find_words(sift_descriptors(read_gray_png(file)), learnt.vocabulary, seen);
    EXPECT_TRUE(std::equal(seen.begin(), seen.end(), learnt.images.row(i).begin())) << i;
    EXPECT_GT(std::accumulate(seen.begin(), seen.end(), 0.0), 5);
  }
  options_.observer.stop = [] { return true; };  // would stop at the first image
  const WordModel kept = train_vocabulary(images_, options_, dir_ / "");
  EXPECT_EQ(kept.vocabulary.values, learnt.vocabulary.values);
  EXPECT_EQ(kept.images.values, learnt.images.values);
  EXPECT_EQ(kept.key, learnt.key);
  options_.seed = 2;
  EXPECT_THROW(train_vocabulary(images_, options_, dir_ / ""), Interrupted)
      << "other words are learnt anew";
}

TEST_F(VisualWords, TrainingIsTheSameForAnyNumberOfThreads) {
  std::filesystem::create_directories(dir_ / "one");
  std::filesystem::create_directories(dir_ / "three");
  const WordModel one = train_vocabulary(images_, options_, dir_ / "one");
  options_.threads = 3;
  const WordModel three = train_vocabulary(images_, options_, dir_ / "three");
  EXPECT_EQ(one.vocabulary.values, three.vocabulary.values);
  EXPECT_EQ(one.images.values, three.images.values);
}

TEST_F(VisualWords, SpreadOverTheImages) {
  options_.images = 4;
  options_.words = 30;
  const WordModel few = train_vocabulary(images_, options_, dir_ / "");
  EXPECT_EQ(few.images.n, 4);
  options_.descriptors = 20;
  expect_error<InputError>([&] { train_vocabulary(images_, options_, dir_ / ""); },
                           {"20", "30 words"});
}

TEST_F(VisualWords, FabMapFindsThePlaceAgain) {
  const FeatureExtractor fabmap =
      word_features(train_vocabulary(images_, options_, dir_ / ""), false);
  ASSERT_TRUE(fabmap.sees<GrayImage>());
  const Observer observer;
  DatasetFeatures features(images_, fabmap, {}, dir_ / "", observer);
  const FeatureFile& file = features.file();
  EXPECT_EQ(features.times().feature.size(), 18U);
  EXPECT_TRUE(std::isnan(features.alignments().at(0).yaw)) << "nothing was aligned";
  FloatMatrix words(18, 60);
  for (int64_t i = 0; i < 18; ++i) std::copy_n(file.row(i).data(), 60, words.row(i).begin());

  Task task;
  for (int64_t i = 0; i < 12; ++i) task.stored.push_back(i);
  for (int64_t i = 12; i < 18; ++i) task.queries.push_back({i, {CandidateRange{0, 12}, {}}});
  for (const Match& match :
       retrieve({words, {}, fabmap.comparison}, task, {.score = Score::kSimilarity})) {
    EXPECT_EQ(match.ranks[0], match.query - 12);
    EXPECT_GT(match.score, 0.5);
    EXPECT_LE(match.score, 1);
  }
}

TEST_F(VisualWords, ABadImageIsNamed) {
  write_file(images_.scans[7].file, "no image");
  expect_error<InputError>([&] { train_vocabulary(images_, options_, dir_ / ""); },
                           {"7.png", "PNG"});
  expect_error<InputError>([&] { train_vocabulary({}, options_, dir_ / ""); },
                           {"expected training images"});
  options_.words = 0;
  expect_error<UsageError>([&] { train_vocabulary(images_, options_, dir_ / ""); }, {"word"});
}

}  // namespace
}  // namespace revisit
