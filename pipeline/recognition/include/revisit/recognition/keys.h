#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "revisit/recognition/matrix.h"
#include "revisit/recognition/similarity.h"

namespace revisit::pipeline {

/// A short vector of a descriptor. The product of two of them says roughly how alike their
/// descriptors are, in less time than their similarity.
struct KeyOf {
  int64_t numbers = 0;  // of a key; 0: there are no keys
  std::function<void(std::span<const float> descriptor, std::span<float> key)> make;
};

/// The keys of all rows of `descriptors`.
FloatMatrix keys_of(const FloatMatrix& descriptors, const KeyOf& key_of);

/// The products of `key` with the rows of `keys` from `first` on, as many as `products` takes.
void products_of_rows(std::span<const float> key, const FloatMatrix& keys, int64_t first,
                      std::span<float> products);

/// Positions of the `count` largest numbers, ascending; of equal ones the earlier.
std::vector<size_t> positions_of_largest(std::span<const float> numbers, int64_t count);

/// Positions in `candidates`, which are rows of `keys`, of those `count` whose product with `key`
/// is the largest, ascending; all of them when there are not more. Of equal ones the earlier.
std::vector<size_t> largest_products(std::span<const float> key, const FloatMatrix& keys,
                                     std::span<const int64_t> candidates, int64_t count);

/// `similarity` of the `count` candidates with the largest products of keys (row i of `keys` is
/// that of the i-th stored descriptor); the others get -1.
Similarity similarity_by_keys(Similarity similarity, const KeyOf& key_of, FloatMatrix keys,
                              int64_t count);

}  // namespace revisit::pipeline
