#include "mutator.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstring>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

namespace revisit::fuzz {
namespace {

std::vector<std::string> words(const char* text) {
  std::istringstream in(text);
  return {std::istream_iterator<std::string>(in), {}};
}
const std::vector<std::string> kTextNumbers = words(
    "0 -1 1 2 3 5 7 16 255 256 65535 1000000 2147483646 2147483647 2147483648 -2147483648 "
    "4294967295 4294967296 1099511627776 9223372036854775807 -9223372036854775808 "
    "18446744073709551615 0.5 -0.0 1e38 1e-45 1e308 nan inf 0x7fffffff");

constexpr std::array<uint64_t, 16> kBinaryNumbers = {
    0,          1,          2,          127,        128,        255,
    32767,      65535,      0x7fffffff, 0x80000000, 0xffffffff, 0x7fc00000 /* NaN */,
    0x7f800000, 1ULL << 32, 1ULL << 62, ~0ULL};

struct Range {
  size_t begin = 0, end = 0;
  size_t size() const { return end - begin; }
};

Range some_chunk(const std::string& bytes, Random& random) {
  const size_t begin = random.below(bytes.size() + 1);
  const size_t most = std::min<size_t>(bytes.size() - begin, random.below(8) == 0 ? 4096 : 64);
  return {begin, begin + random.below(most + 1)};
}

Range some_lines(const std::string& bytes, Random& random) {
  const size_t from = random.below(bytes.size() + 1);
  const size_t newline = from == 0 ? std::string::npos : bytes.rfind('\n', from - 1);
  Range range{newline == std::string::npos ? 0 : newline + 1, 0};
  range.end = range.begin;
  for (size_t lines = 1 + random.below(4); lines > 0 && range.end < bytes.size(); --lines)
    range.end = std::min(bytes.find('\n', range.end), bytes.size() - 1) + 1;
  return range;
}

size_t some_line_start(const std::string& bytes, Random& random) {
  return some_lines(bytes, random).begin;
}

bool is_numeric(char c) {
  return std::isdigit(static_cast<unsigned char>(c)) || c == '-' || c == '.' || c == '+';
}

bool is_text(const std::string& bytes) {
  return std::all_of(bytes.begin(), bytes.begin() + std::min<std::ptrdiff_t>(std::ssize(bytes), 64),
                     [](unsigned char c) { return std::isprint(c) || std::isspace(c); });
}

void replace_text_number(std::string& bytes, Random& random) {
  const size_t from = random.below(bytes.size());
  const auto digit = std::find_if(bytes.begin() + static_cast<std::ptrdiff_t>(from), bytes.end(),
                                  [](char c) { return c >= '0' && c <= '9'; });
  if (digit == bytes.end()) return;
  auto begin = digit, end = digit;
  while (begin != bytes.begin() && is_numeric(begin[-1])) --begin;
  while (end != bytes.end() && is_numeric(*end)) ++end;
  const bool small = random.below(2) == 0;
  bytes.replace(
      begin, end,
      small ? std::to_string(random.below(10)) : kTextNumbers[random.below(kTextNumbers.size())]);
}

void overwrite_binary_number(std::string& bytes, Random& random) {
  const uint64_t value = kBinaryNumbers[random.below(kBinaryNumbers.size())];
  const size_t width = size_t{1} << random.below(4);
  const size_t at = random.below(bytes.size());
  std::memcpy(bytes.data() + at, &value, std::min(width, bytes.size() - at));
}

void change_bytes(std::string& bytes, Random& random) {
  const size_t at = random.below(bytes.size());
  switch (random.below(4)) {
    case 0:
      bytes[at] = static_cast<char>(bytes[at] ^ (1 << random.below(8)));
      break;
    case 1:
      bytes[at] = static_cast<char>(random.below(256));
      break;
    case 2:
      bytes.insert(at, 1, static_cast<char>(random.below(256)));
      break;
    default:
      bytes.erase(at, 1 + random.below(4));
  }
}

void move_chunks(std::string& bytes, const std::string& other, Random& random) {
  const bool foreign = random.below(2) == 0;
  const std::string& source = foreign ? other : bytes;
  const Range from = some_chunk(source, random);
  const std::string chunk = source.substr(from.begin, from.size());
  const size_t at = random.below(bytes.size() + 1);
  if (random.below(2) == 0)
    bytes.insert(at, chunk);
  else
    bytes.replace(at, std::min(chunk.size(), bytes.size() - at), chunk);
}

void cut(std::string& bytes, const std::string& other, Random& random) {
  const Range chunk = some_chunk(bytes, random);
  switch (random.below(3)) {
    case 0:
      bytes.erase(chunk.begin, chunk.size());
      break;
    case 1:
      bytes.resize(random.below(bytes.size() + 1));
      break;
    default:  // the beginning of one and the end of the other
      bytes = bytes.substr(0, random.below(bytes.size() + 1)) +
              other.substr(random.below(other.size() + 1));
  }
}

}  // namespace

uint64_t Random::next() {
  uint64_t z = state_ += 0x9E3779B97F4A7C15ULL;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
  return z ^ (z >> 31);
}

void mutate_structure(std::string& bytes, const std::string& other, size_t longest,
                      Random& random) {
  if (bytes.empty()) bytes = other;
  if (bytes.empty()) bytes = "0";
  const Range lines = some_lines(bytes, random), foreign = some_lines(other, random);
  switch (random.below(6)) {
    case 0:
    case 1:
      replace_text_number(bytes, random);
      break;
    case 2:
      overwrite_binary_number(bytes, random);
      break;
    case 3:
      bytes.erase(lines.begin, lines.size());
      break;
    case 4:
      bytes.insert(some_line_start(bytes, random), other, foreign.begin, foreign.size());
      break;
    default:
      bytes.insert(some_line_start(bytes, random), bytes.substr(lines.begin, lines.size()));
  }
  if (bytes.size() > longest) bytes.resize(longest);
}

void mutate(std::string& bytes, const std::string& other, size_t longest, Random& random) {
  do {
    if (bytes.empty()) bytes = "0";
    // Changed bytes rarely yield valid text.
    const size_t kind = random.below(is_text(bytes) ? 64 : 16);
    if (kind < 4)
      change_bytes(bytes, random);
    else if (kind < 8)
      move_chunks(bytes, other, random);
    else if (kind < 9)
      cut(bytes, other, random);
    else
      mutate_structure(bytes, other, longest, random);
  } while (random.below(2) == 0);
  if (bytes.size() > longest) bytes.resize(longest);
}

}  // namespace revisit::fuzz
