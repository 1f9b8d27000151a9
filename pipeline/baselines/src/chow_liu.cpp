#include <bit>
#include <cmath>

#include "revisit/base/error.h"
#include "revisit/baselines/fabmap.h"

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

}  // namespace revisit
