#pragma once

#include <cstdint>
#include <string>

namespace revisit::fuzz {

/// splitmix64 (Steele, Lea, Flood 2014): the same cases on every machine.
class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed) {}
  uint64_t next();
  /// Uniform enough in [0, n); 0 for n = 0.
  size_t below(size_t n) { return n == 0 ? 0 : static_cast<size_t>(next() % n); }

 private:
  uint64_t state_;
};

/// Mutates `bytes` in one to a few places, as text or binary: bit flips, insertions, removals,
/// chunks copied within and from `other`, numbers at the limits of their types, truncation. The
/// result has at most `longest` bytes.
void mutate(std::string& bytes, const std::string& other, size_t longest, Random& random);

/// Applies one mutation of numbers or lines, which byte-wise fuzzers rarely find.
void mutate_structure(std::string& bytes, const std::string& other, size_t longest, Random& random);

}  // namespace revisit::fuzz
