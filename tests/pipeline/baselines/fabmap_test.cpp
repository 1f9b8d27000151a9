#include "fabmap.h"

#include "float_matrix.h"
#include "testing.h"

namespace revisit {
namespace {

FloatMatrix random_words(int64_t images, int64_t words, unsigned seed) {
  // Words come in groups that tend to appear together.
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform;
  FloatMatrix m(images, words);
  for (int64_t i = 0; i < images; ++i) {
    bool group = false;
    for (int64_t w = 0; w < words; ++w) {
      if (w % 3 == 0) group = uniform(random) < 0.5;
      m.row(i)[static_cast<size_t>(w)] = uniform(random) < (group ? 0.7 : 0.1) ? 1 : 0;
    }
  }
  return m;
}

TEST(ChowLiu, ByHand) {
  // Words 0 and 2 always occur together; word 1 is independent of them.
  const FloatMatrix images = matrix({{1, 1, 1}, {1, 0, 1}, {0, 1, 0}, {0, 0, 0}});
  // With the pseudo-image, of 5: p(0,2 = 1,1) = p(0,0) = 2.25/5 = 0.45, p(1,0) = 0.05. Mutual
  // information 0.9 ln(0.45/0.25) + 0.1 ln(0.05/0.25) = 0.368. Word 1: all four are 1.25/5 = 0.25
  // with either, information 0; it joins at its lowest neighbor.
  const ChowLiuTree tree = chow_liu_tree(images);
  EXPECT_EQ(tree.parent, (std::vector<int>{-1, 0, 0}));
  for (const double p : tree.marginal) EXPECT_NEAR(p, 2.5 / 5, 1e-12);
  EXPECT_NEAR(tree.given_parent[2][0], 0.05 / 0.5, 1e-12);
  EXPECT_NEAR(tree.given_parent[2][1], 0.45 / 0.5, 1e-12);
  EXPECT_NEAR(tree.given_parent[1][0], 0.5, 1e-12);
  EXPECT_NEAR(tree.given_parent[1][1], 0.5, 1e-12);
}

double information(const FloatMatrix& images, int64_t a, int64_t b) {
  double joint[2][2] = {{0.25, 0.25}, {0.25, 0.25}};
  for (int64_t i = 0; i < images.n; ++i) joint[images.row(i)[a] > 0][images.row(i)[b] > 0] += 1;
  double sum = 0;
  const double n = static_cast<double>(images.n) + 1;
  for (int x = 0; x < 2; ++x)
    for (int y = 0; y < 2; ++y)
      sum +=
          joint[x][y] / n *
          std::log(joint[x][y] * n / ((joint[x][0] + joint[x][1]) * (joint[0][y] + joint[1][y])));
  return sum;
}

TEST(ChowLiu, NoOtherTreeHasMoreInformation) {
  // All 6^4 = 1296 trees of 6 words, each by its Pruefer sequence.
  for (unsigned seed = 0; seed < 5; ++seed) {
    const FloatMatrix images = random_words(70, 6, seed);
    double best = 0;
    for (int code = 0; code < 6 * 6 * 6 * 6; ++code) {
      const int sequence[4] = {code % 6, code / 6 % 6, code / 36 % 6, code / 216};
      int degree[6] = {1, 1, 1, 1, 1, 1};
      for (const int node : sequence) ++degree[node];
      double sum = 0;
      for (const int node : sequence) {
        const int leaf = static_cast<int>(std::find(degree, degree + 6, 1) - degree);
        sum += information(images, leaf, node);
        degree[leaf] = 0;
        --degree[node];
      }
      const int first = static_cast<int>(std::find(degree, degree + 6, 1) - degree);
      const int second = static_cast<int>(std::find(degree + first + 1, degree + 6, 1) - degree);
      best = std::max(best, sum + information(images, first, second));
    }
    const ChowLiuTree tree = chow_liu_tree(images);
    double found = 0;
    for (int word = 1; word < 6; ++word) found += information(images, word, tree.parent[word]);
    EXPECT_NEAR(found, best, 1e-12) << seed;
    EXPECT_EQ(tree.parent[0], -1);
  }
}

/// p(z1 = 1 | z0) = 1/4, 3/4 and p(z2 = 1 | z1) = 1/3, 2/3.
ChowLiuTree chain() {
  return {{-1, 0, 1}, {0.5, 0.5, 0.5}, {{0.5, 0.5}, {0.25, 0.75}, {1.0 / 3, 2.0 / 3}}};
}

FabMapOptions half(double smoothing = 1) {
  return {.p_detected_if_present = 0.5,
          .p_detected_if_absent = 0,
          .p_new_place = 0.5,
          .smoothing = smoothing};
}

// By hand, for the image Z = (1, 1, 0) and the places A = (1, 1, 0), B = (0, 1, 1).
//
// Content of a place, given its words: p(e = 1 | z = 1) = 1 (nothing absent is seen);
//   p(e = 1 | z = 0) = (1/2 1/2) / (1/2 1/2 + 1 1/2) = 1/3; the average place: p(e = 1) = 1/2.
// Probability of seeing a present word, given its parent (alpha and beta of eq. 14 to 16): word 1,
//   z0 = 1: alpha = 1/2 1/2 1/4 = 1/16, beta = 1/2 1/2 3/4 = 3/16, so 3/4; z0 = 0: 1/4.
//   Word 2: z1 = 1: 2/3, z1 = 0: 1/3. The root: 1/2. A word that is absent: 0.
//
//              z0 = 1            z1 = 1 (z0 = 1)     z2 = 0 (z1 = 1)        product
// A            1 1/2   = 1/2     1 3/4   = 3/4       1 - 1/3 2/3 = 7/9      7/24
// B            1/3 1/2 = 1/6     1 3/4   = 3/4       1 - 1 2/3   = 1/3      1/24
// average      1/2 1/2 = 1/4     1/2 3/4 = 3/8       1 - 1/2 2/3 = 2/3      1/16
// (0, 0, 0)    1/3 1/2 = 1/6     1/3 3/4 = 1/4       1 - 1/3 2/3 = 7/9      7/216
// (1, 1, 1)    1 1/2   = 1/2     1 3/4   = 3/4       1 - 1 2/3   = 1/3      1/8 = 27/216
const FloatMatrix kWordsOfPlaces = matrix({{1, 1, 0}, {0, 1, 1}});
const std::vector<float> kSeen{1, 1, 0};
const std::vector<int64_t> kBoth{0, 1};

TEST(FabMap, LikelihoodsByHand) {
  const FabMap map(chain(), half());
  EXPECT_NEAR(std::exp(map.log_likelihood(kSeen, kWordsOfPlaces.row(0))), 7.0 / 24, 1e-12);
  EXPECT_NEAR(std::exp(map.log_likelihood(kSeen, kWordsOfPlaces.row(1))), 1.0 / 24, 1e-12);
  EXPECT_NEAR(std::exp(map.log_likelihood_of_new_place(kSeen)), 1.0 / 16, 1e-12);
  const FabMap sampled(chain(), half(), matrix({{0, 0, 0}, {1, 1, 1}}));
  EXPECT_NEAR(std::exp(sampled.log_likelihood_of_new_place(kSeen)), (7.0 + 27.0) / 216 / 2, 1e-12);
}

TEST(FabMap, LikelihoodsOfAllImagesSumToOne) {
  const FabMap map(
      {{2, 2, -1, 0}, {0.2, 0.4, 0.7, 0.5}, {{0.1, 0.243}, {0.5, 0.357}, {0.7, 0.7}, {0.6, 0.1}}},
      {});
  std::vector<double> sums(17);
  for (int image = 0; image < 16; ++image) {
    const auto bits = [](int number) {
      return std::vector<float>{static_cast<float>(number & 1), static_cast<float>(number >> 1 & 1),
                                static_cast<float>(number >> 2 & 1),
                                static_cast<float>(number >> 3)};
    };
    for (int place = 0; place < 16; ++place)
      sums[static_cast<size_t>(place)] += std::exp(map.log_likelihood(bits(image), bits(place)));
    sums[16] += std::exp(map.log_likelihood_of_new_place(bits(image)));
  }
  for (const double sum : sums) EXPECT_NEAR(sum, 1, 1e-12);
}

TEST(FabMap, PosteriorByHand) {
  // Priors 1/4, 1/4 and 1/2 (new): 7/96, 1/96 and 3/96.
  std::vector<double> p(2);
  FabMap(chain(), half()).posterior(kSeen, rows_of(kWordsOfPlaces, kBoth), p);
  EXPECT_NEAR(p[0], 7.0 / 11, 1e-12);
  EXPECT_NEAR(p[1], 1.0 / 11, 1e-12);
  // Likelihoods 7/24, 1/24, 1/16 are 14 : 2 : 3 of 19; smoothed with 0.9: 0.9 14/19 + 0.1/3.
  FabMap(chain(), half(0.9)).posterior(kSeen, rows_of(kWordsOfPlaces, kBoth), p);
  const double a = 0.9 * 14 / 19 + 0.1 / 3, b = 0.9 * 2 / 19 + 0.1 / 3, n = 0.9 * 3 / 19 + 0.1 / 3;
  EXPECT_NEAR(p[0], a / (a + b + 2 * n), 1e-12);
  EXPECT_NEAR(p[1], b / (a + b + 2 * n), 1e-12);
  // Only B is a candidate: prior 1/2, against 1/2 for the new place.
  std::vector<double> one(1);
  FabMap(chain(), half()).posterior(kSeen, rows_of(kWordsOfPlaces, std::vector<int64_t>{1}), one);
  EXPECT_NEAR(one[0], (1.0 / 24) / (1.0 / 24 + 1.0 / 16), 1e-12);
}

TEST(FabMap, PosteriorIsThatOfTheLikelihoods) {
  const FloatMatrix images = random_words(60, 30, 1);
  const FloatMatrix samples = random_words(9, 30, 2);
  const FabMap map(chow_liu_tree(images), {.smoothing = 1}, samples);
  std::vector<int64_t> candidates(59);
  std::iota(candidates.begin(), candidates.end(), 1);
  std::vector<double> p(candidates.size());
  map.posterior(images.row(0), rows_of(images, candidates), p);
  const double fresh = 0.9 * std::exp(map.log_likelihood_of_new_place(images.row(0)));
  double evidence = fresh;
  for (const int64_t c : candidates)
    evidence += 0.1 / 59 * std::exp(map.log_likelihood(images.row(0), images.row(c)));
  for (size_t i = 0; i < p.size(); ++i)
    EXPECT_NEAR(p[i],
                0.1 / 59 * std::exp(map.log_likelihood(images.row(0), images.row(candidates[i]))) /
                    evidence,
                1e-12);
}

TEST(FabMap, ManyWordsDoNotUnderflow) {
  const FloatMatrix images = random_words(40, 3000, 3);
  const FabMap map(chow_liu_tree(random_words(40, 3000, 4)), {});
  std::vector<double> p(2);
  map.posterior(images.row(0), rows_of(images, std::vector<int64_t>{0, 7}), p);
  EXPECT_LT(map.log_likelihood(images.row(0), images.row(7)), -745) << "else nothing is tested";
  EXPECT_GT(p[0], 0.9);
  EXPECT_LT(p[1], 0.1);
}

TEST(ChowLiu, NeedsImages) {
  expect_error<UsageError>([] { chow_liu_tree(FloatMatrix(0, 5)); }, {"images"});
}

}  // namespace
}  // namespace revisit
