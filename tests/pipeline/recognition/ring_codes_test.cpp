#include <complex>

#include "revisit/recognition/matrix.h"
#include "ring/codes.h"
#include "simd_targets.h"
#include "testing.h"

namespace revisit {
namespace {

using Coefficients = std::vector<std::vector<std::complex<int>>>;  // [frequency]

/// Layout of a model of 1024 dimensions; a code has fewer.
const RingLayout kMany{39, 39, 38, 34, 34, 35, 33, 31, 29, 29, 30, 27, 28, 27, 27, 26, 25};
const RingLayout kFew{3, 2, 5, 1};

FloatMatrix random_descriptors(int64_t n, const RingLayout& layout) {
  FloatMatrix all(n, dim_of(layout));
  std::mt19937 random(6);
  std::normal_distribution<float> gaussian;
  for (float& value : all.values) value = gaussian(random);
  return all;
}

std::complex<double> as_double(std::complex<int> z) {
  return {static_cast<double>(z.real()), static_cast<double>(z.imag())};
}

/// Reference: the largest sum over frequencies of Re(exp(2 pi i f s / 32) sum of a conj(b)).
double slow_product(const Coefficients& a, const Coefficients& b) {
  double largest = -1e9;
  for (int s = 0; s < 32; ++s) {
    double sum = 0;
    for (size_t f = 0; f < a.size(); ++f)
      for (size_t i = 0; i < a[f].size(); ++i)
        sum += (std::polar(1.0, kTurn * static_cast<double>(f) * s / 32) * as_double(a[f][i]) *
                std::conj(as_double(b[f][i])))
                   .real();
    largest = std::max(largest, sum);
  }
  return largest;
}

/// Tests products of one query with 32 * `groups` codes.
void expect_slow_products(const std::vector<int>& counts, size_t groups, int largest_of_query,
                          const std::function<int(int largest)>& part) {
  Coefficients a(counts.size());
  CodeQuery query;
  for (size_t f = 0; f < counts.size(); ++f) {
    query.counts[f] = counts[f];
    for (int i = 0; i < counts[f]; ++i) {
      const std::complex<int> number(part(largest_of_query), part(largest_of_query));
      a[f].push_back(number);
      query.parts.push_back(static_cast<int16_t>(number.real()));
      query.parts.push_back(static_cast<int16_t>(number.imag()));
    }
  }
  const size_t n = groups * kCodesPerGroup, coefficients = query.parts.size() / 2;
  std::vector<Coefficients> b(n, Coefficients(counts.size()));
  std::vector<float> scales, largest(n);
  const auto codes = hwy::AllocateAligned<uint8_t>(std::max<size_t>(1, n * coefficients));
  for (size_t place = 0; place < n; ++place) {
    scales.push_back(static_cast<float>(place % 5));
    size_t at = place / kCodesPerGroup * kCodesPerGroup * coefficients + place % kCodesPerGroup;
    for (size_t f = 0; f < counts.size(); ++f)
      for (int i = 0; i < counts[f]; ++i, at += kCodesPerGroup) {
        const std::complex<int> number(part(kMaxPart), part(kMaxPart));
        b[place][f].push_back(number);
        codes[at] =
            static_cast<uint8_t>((number.real() + 16) % 16 + (number.imag() + 16) % 16 * 16);
      }
  }
  std::vector<double> expected;
  for (size_t place = 0; place < n; ++place)
    expected.push_back(slow_product(a, b[place]) * static_cast<double>(scales[place]));
  test::for_each_simd_target([&] {
    max_code_products(query, codes.get(), scales, largest);
    for (size_t place = 0; place < n; ++place)
      EXPECT_NEAR(static_cast<double>(largest[place]), expected[place],
                  1e-5 * std::abs(expected[place]) + 0.01)
          << place;
  });
}

TEST(RingCodeProducts, AreThoseOfTheSlowTwin) {
  std::mt19937 random(4);
  const auto any = [&random](int largest) {
    return static_cast<int>(random() % static_cast<uint32_t>(2 * largest + 1)) - largest;
  };
  const std::vector<int> of_a_model{5, 9, 9, 8, 8, 8, 8, 7, 7, 7, 7, 7, 7, 7, 7, 6, 6};
  for (const size_t groups : {0U, 1U, 3U}) expect_slow_products(of_a_model, groups, 200, any);
  expect_slow_products({3}, 2, 100, any);
  expect_slow_products({0, 1}, 2, 1000, any);
  expect_slow_products({1, 0, 4, 0, 0, 2}, 2, 100, any);
  expect_slow_products({}, 1, 1, any);
}

TEST(RingCodeProducts, FillSixteenBits) {
  const auto largest = [](int most) { return most; };
  expect_slow_products({0, 128}, 1, 18, largest);  // 128 * 2 * 7 * 18 = 32256
  expect_slow_products({0, 0, 1}, 1, 2340, largest);
}

struct SlowCode {
  Coefficients coefficients;
  double scale = 0;
};

/// Reference code: every frequency has its fraction of 128 coefficients, evenly spaced, with parts
/// rounded to at most `largest`; two real ones of frequency 0 make one.
SlowCode slow_code(std::span<const float> x, const RingLayout& layout, double largest) {
  std::vector<std::vector<std::complex<double>>> z;
  double all = 0, most = 0;
  size_t first = 0;
  for (size_t f = 0; f < layout.size(); ++f) {
    const auto n = static_cast<size_t>(layout[f]);
    auto& coefficients = z.emplace_back();
    if (f > 0)
      for (size_t i = first; i < first + n; ++i) coefficients.emplace_back(x[i], x[n + i]);
    else
      for (size_t i = 0; i < n; i += 2) coefficients.emplace_back(x[i], i + 1 < n ? x[i + 1] : 0);
    all += static_cast<double>(coefficients.size());
    first += f > 0 ? 2 * n : n;
  }
  for (auto& coefficients : z) {
    const auto there = static_cast<double>(coefficients.size()),
               kept = std::round(there * std::min(1.0, 128 / all));
    for (double i = 0; i < kept; ++i)
      coefficients[static_cast<size_t>(i)] = coefficients[static_cast<size_t>(i * there / kept)];
    coefficients.resize(static_cast<size_t>(kept));
    for (const auto& number : coefficients)
      most = std::max({most, std::abs(number.real()), std::abs(number.imag())});
  }
  SlowCode code{Coefficients(z.size()), most / largest};
  for (size_t f = 0; f < z.size(); ++f)
    for (const auto& number : z[f])
      code.coefficients[f].emplace_back(most > 0 ? std::lround(number.real() / code.scale) : 0,
                                        most > 0 ? std::lround(number.imag() / code.scale) : 0);
  return code;
}

/// Limit of 16-bit sums: 2^15 - 1 over 2 * 7 times the most coefficients of a frequency.
double largest_of_query(const RingLayout& layout) {
  size_t most = 0;
  const std::vector<float> zeros(static_cast<size_t>(dim_of(layout)));
  for (const auto& of_frequency : slow_code(zeros, layout, 1).coefficients)
    most = std::max(most, of_frequency.size());
  return std::floor(32767 / (14 * static_cast<double>(most)));
}

void expect_the_most_similar(const FloatMatrix& all, const RingLayout& layout,
                             const std::vector<CandidateRange>& among, int64_t count) {
  RingCodes codes(layout);
  for (int64_t i = 0; i < all.n; ++i) codes.add(all.row(i));
  EXPECT_EQ(codes.size(), all.n);
  const std::span<const float> query = all.row(all.n / 2);
  const SlowCode asked = slow_code(query, layout, largest_of_query(layout));
  std::vector<int64_t> chosen, again;
  codes.find(query, among, count, 1, chosen);
  for (const int threads : {2, 3}) {
    codes.find(query, among, count, threads, again);
    EXPECT_EQ(again, chosen) << threads;
  }
  double least_chosen = 1e9, largest_other = -1e9;
  int64_t candidates = 0;
  for (const CandidateRange& range : among)
    for (int64_t i = range.begin; i < range.end; ++i, ++candidates) {
      const SlowCode code = slow_code(all.row(i), layout, 7);
      const double similarity =
          slow_product(asked.coefficients, code.coefficients) * code.scale * asked.scale;
      if (std::ranges::count(chosen, i) == 1)
        least_chosen = std::min(least_chosen, similarity);
      else
        largest_other = std::max(largest_other, similarity);
    }
  EXPECT_EQ(static_cast<int64_t>(chosen.size()), std::min(count, candidates));
  if (count < candidates) {
    EXPECT_GE(least_chosen, largest_other - 1e-4);
  }
}

TEST(RingCodes, ProposeTheMostSimilarOfTheSlowTwin) {
  for (const RingLayout& layout : {kMany, kFew, RingLayout{1}, RingLayout{0, 0, 600}})
    for (const int64_t n : {1, 15, 17, 32, 33}) {
      const FloatMatrix all = random_descriptors(n, layout);
      for (const int64_t count : {int64_t{1}, int64_t{5}, n, n + 3})
        expect_the_most_similar(all, layout, {{0, n}}, count);
    }
}

TEST(RingCodes, RangesMayBeginAndEndAnywhere) {
  const FloatMatrix all = random_descriptors(2100, kFew);
  expect_the_most_similar(all, kFew, {{0, 1}, {2, 33}, {34, 64}, {1000, 1040}, {2047, 2100}}, 50);
  expect_the_most_similar(all, kFew, {{1, 2099}}, 1000);
  expect_the_most_similar(all, kFew, {{1023, 1025}}, 1);
  expect_the_most_similar(all, kFew, {}, 5);
}

TEST(RingCodes, OfZerosAreLikeNothing) {
  FloatMatrix all = random_descriptors(40, kMany);
  std::ranges::fill(all.row(7), 0.0F);
  RingCodes codes(kMany);
  for (int64_t i = 0; i < all.n; ++i) codes.add(all.row(i));
  const CandidateRange among{0, 40};
  std::vector<int64_t> places;
  codes.find(all.row(3), {&among, 1}, 39, 1, places);  // whose largest product is above 0
  EXPECT_EQ(std::ranges::count(places, 7), 0);
  codes.find(all.row(7), {&among, 1}, 5, 1, places);
  EXPECT_EQ(places, (std::vector<int64_t>{0, 1, 2, 3, 4}));  // all are equal
}

TEST(RingCodes, TakeNumbersOfAnySize) {
  FloatMatrix all = random_descriptors(30, kFew);
  for (int64_t i = 0; i < all.n; ++i)
    for (float& v : all.row(i)) v *= i % 3 == 0 ? 1e-42F : i % 3 == 1 ? 1e37F : 1;
  const CandidateRange among{0, 30};
  RingCodes codes(kFew);
  for (int64_t i = 0; i < all.n; ++i) codes.add(all.row(i));
  std::vector<int64_t> places;
  for (int64_t q = 0; q < 3; ++q) {
    codes.find(all.row(q), {&among, 1}, 10, 1, places);
    for (size_t i = 0; i < 10; ++i) EXPECT_EQ(places[i], static_cast<int64_t>(3 * i + 1)) << q;
  }
}

std::vector<float> turned_ring(std::span<const float> x, const RingLayout& layout, double angle) {
  std::vector<float> result(x.begin(), x.end());
  size_t at = static_cast<size_t>(layout[0]);
  for (size_t f = 1; f < layout.size(); ++f) {
    const auto n = static_cast<size_t>(layout[f]);
    for (size_t i = at; i < at + n; ++i) {
      const auto z =
          std::complex<double>(x[i], x[n + i]) * std::polar(1.0, static_cast<double>(f) * angle);
      result[i] = static_cast<float>(z.real());
      result[n + i] = static_cast<float>(z.imag());
    }
    at += 2 * n;
  }
  return result;
}

TEST(RingCodes, FindAPlaceAtAnyHeading) {
  FloatMatrix all = random_descriptors(3000, kMany);
  // Low frequencies of rings vary most.
  for (int64_t i = 0; i < all.n; ++i) {
    size_t at = 0;
    for (size_t f = 0; f < kMany.size(); ++f)
      for (int j = 0; j < (f > 0 ? 2 : 1) * kMany[f]; ++j)
        all.row(i)[at++] /= static_cast<float>(1 + f);
  }
  RingCodes codes(kMany);
  for (int64_t i = 0; i < all.n; ++i) codes.add(all.row(i));
  const CandidateRange among{0, all.n};
  std::vector<int64_t> places;
  for (int64_t place = 0; place < all.n; place += 30) {
    codes.find(turned_ring(all.row(place), kMany, 0.1 * static_cast<double>(place)), {&among, 1}, 1,
               1, places);
    EXPECT_EQ(places, std::vector<int64_t>{place});
  }
}

}  // namespace
}  // namespace revisit
