#include "fabmap.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "revisit/base/error.h"

namespace revisit {

namespace {

using Bits = std::vector<uint64_t>;

std::vector<Bits> bits_of(const FloatMatrix& images) {
  std::vector<Bits> words(static_cast<size_t>(images.d),
                          Bits(static_cast<size_t>(images.n + 63) / 64));
  for (int64_t image = 0; image < images.n; ++image)
    for (int64_t word = 0; word < images.d; ++word)
      if (images.row(image)[static_cast<size_t>(word)] > 0)
        words[static_cast<size_t>(word)][static_cast<size_t>(image / 64)] |= uint64_t{1}
                                                                             << image % 64;
  return words;
}

double count_both(const Bits& a, const Bits& b) {
  int count = 0;
  for (size_t i = 0; i < a.size(); ++i) count += std::popcount(a[i] & b[i]);
  return count;
}

/// p(a, b) as [a][b], including the pseudo-image.
using Joint = std::array<std::array<double, 2>, 2>;
Joint joint_of(const Bits& a, const Bits& b, int64_t images) {
  const double both = count_both(a, b), of_a = count_both(a, a), of_b = count_both(b, b);
  const auto n = static_cast<double>(images);
  const auto p = [n](double count) { return (count + 0.25) / (n + 1); };
  return {{{p(n - of_a - of_b + both), p(of_b - both)}, {p(of_a - both), p(both)}}};
}

/// [nats]
double mutual_information(const Joint& joint) {
  double sum = 0;
  for (size_t a = 0; a < 2; ++a)
    for (size_t b = 0; b < 2; ++b) {
      const double of_a = joint[a][0] + joint[a][1], of_b = joint[0][b] + joint[1][b];
      sum += joint[a][b] * std::log(joint[a][b] / (of_a * of_b));
    }
  return sum;
}

}  // namespace

ChowLiuTree chow_liu_tree(const FloatMatrix& images) {
  if (images.n < 1 || images.d < 1)
    throw UsageError("Chow-Liu tree: expected images and words, found ", images.n, " x ", images.d);
  const std::vector<Bits> bits = bits_of(images);
  const auto words = static_cast<size_t>(images.d);
  ChowLiuTree tree;
  tree.parent.assign(words, -1);
  for (const Bits& word : bits)
    tree.marginal.push_back((count_both(word, word) + 0.5) / (static_cast<double>(images.n) + 1));
  for (const double p : tree.marginal) tree.given_parent.push_back({p, p});

  // Prim's algorithm from word 0; on a tie the lowest word joins the tree. `nearness`: mutual
  // information with the tree, always above -1.
  std::vector<double> nearness(words, -1);
  std::vector<bool> in_tree(words, false);
  for (size_t joined = 0, count = 1; count < words; ++count) {
    in_tree[joined] = true;
    size_t next = words;
    for (size_t word = 0; word < words; ++word) {
      if (in_tree[word]) continue;
      const double information = mutual_information(joint_of(bits[word], bits[joined], images.n));
      if (information > nearness[word]) {
        nearness[word] = information;
        tree.parent[word] = static_cast<int>(joined);
      }
      if (next == words || nearness[word] > nearness[next]) next = word;
    }
    const Joint joint =
        joint_of(bits[next], bits[static_cast<size_t>(tree.parent[next])], images.n);
    for (size_t z = 0; z < 2; ++z)
      tree.given_parent[next][z] = joint[1][z] / (joint[0][z] + joint[1][z]);
    joined = next;
  }
  return tree;
}

namespace {

double probability(double p, size_t value) {
  return value ? p : 1 - p;
}

struct Word {
  double marginal;
  std::array<double, 2> given_parent;
  std::array<double, 2> seen_if;  // p(z = 1 | e = 0, 1)

  /// p(e = 1 | z), with the marginal of z as the prior of e (IJRR 2008, eq. 17 from one image).
  double there_if(size_t z) const {
    const double there = probability(seen_if[1], z) * marginal;
    const double absent = probability(seen_if[0], z) * (1 - marginal);
    return there / (there + absent);
  }

  /// p(z | e, parent's z), eq. 14 to 16: e and the parent's z are independent given z.
  double seen(size_t z, size_t e, size_t parent) const {
    const double alpha = probability(marginal, z) * probability(seen_if[e], 1 - z) *
                         probability(given_parent[parent], 1 - z);
    const double beta = probability(marginal, 1 - z) * probability(seen_if[e], z) *
                        probability(given_parent[parent], z);
    return beta / (alpha + beta);
  }

  /// ln p(z | parent's z, L) where p(e = 1 | L) is `there` (eq. 11).
  std::array<std::array<double, 2>, 2> table(double there) const {
    std::array<std::array<double, 2>, 2> result{};
    for (size_t z = 0; z < 2; ++z)
      for (size_t parent = 0; parent < 2; ++parent)
        result[z][parent] = std::log(there * seen(z, 1, parent) + (1 - there) * seen(z, 0, parent));
    return result;
  }
};

}  // namespace

FabMap::FabMap(const ChowLiuTree& tree, const FabMapOptions& options, const FloatMatrix& samples)
    : options_(options), samples_(samples) {
  for (size_t i = 0; i < tree.parent.size(); ++i) {
    const Word word{tree.marginal[i],
                    tree.given_parent[i],
                    {options.p_detected_if_absent, options.p_detected_if_present}};
    terms_.push_back({tree.parent[i],
                      {word.table(word.there_if(0)), word.table(word.there_if(1))},
                      word.table(word.marginal)});
  }
}

double FabMap::term(const Table& table, size_t word, std::span<const float> seen) const {
  const int parent = terms_[word].parent;
  const bool parent_seen = parent >= 0 && seen[static_cast<size_t>(parent)] > 0;
  return table[seen[word] > 0 ? 1 : 0][parent_seen ? 1 : 0];
}

double FabMap::log_likelihood(std::span<const float> seen, std::span<const float> place) const {
  double sum = 0;
  for (size_t word = 0; word < terms_.size(); ++word)
    sum += term(terms_[word].place[place[word] > 0 ? 1 : 0], word, seen);
  return sum;
}

double FabMap::log_likelihood_of_new_place(std::span<const float> seen) const {
  if (samples_.n == 0) {
    double sum = 0;
    for (size_t word = 0; word < terms_.size(); ++word)
      sum += term(terms_[word].average, word, seen);
    return sum;
  }
  std::vector<double> logs;
  for (int64_t i = 0; i < samples_.n; ++i) logs.push_back(log_likelihood(seen, samples_.row(i)));
  const double most = *std::max_element(logs.begin(), logs.end());
  double sum = 0;
  for (const double log : logs) sum += std::exp(log - most);
  return most + std::log(sum / static_cast<double>(samples_.n));
}

void FabMap::posterior(std::span<const float> seen, std::span<const std::span<const float>> places,
                       std::span<double> probabilities) const {
  // For a fixed query, ln p(Z | L) = base + sum of `gain` over the words of the place.
  double base = 0;
  std::vector<double> gain;
  for (size_t word = 0; word < terms_.size(); ++word) {
    const double without = term(terms_[word].place[0], word, seen);
    base += without;
    gain.push_back(term(terms_[word].place[1], word, seen) - without);
  }
  const double new_place = log_likelihood_of_new_place(seen);
  double most = new_place;
  for (size_t i = 0; i < places.size(); ++i) {
    double sum = base;
    for (size_t word = 0; word < gain.size(); ++word)
      if (places[i][word] > 0) sum += gain[word];
    probabilities[i] = sum;
    most = std::max(most, sum);
  }

  double total = std::exp(new_place - most);
  for (double& p : probabilities) total += (p = std::exp(p - most));
  const auto n_places = static_cast<double>(places.size());
  const auto smoothed = [&](double likelihood) {
    return options_.smoothing * likelihood / total + (1 - options_.smoothing) / (n_places + 1);
  };
  double evidence = options_.p_new_place * smoothed(std::exp(new_place - most));
  for (double& p : probabilities)
    evidence += (p = (1 - options_.p_new_place) / n_places * smoothed(p));
  for (double& p : probabilities) p /= evidence;
}

}  // namespace revisit
