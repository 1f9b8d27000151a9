#include "log_check.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/files.h"

namespace revisit {
namespace {

constexpr uint64_t kHeaderBytes = 32, kFrameHeaderBytes = 24;

uint32_t big_endian(const uint8_t* bytes) {
  return uint32_t{bytes[0]} << 24 | uint32_t{bytes[1]} << 16 | uint32_t{bytes[2]} << 8 | bytes[3];
}

/// SQLite's cumulative checksum over pairs of 32-bit words.
struct Checksum32 {
  bool words_are_big_endian = false;
  uint32_t first = 0, second = 0;

  void add(std::span<const uint8_t> bytes) {
    const auto word = [this](const uint8_t* at) {
      const uint32_t big = big_endian(at);
      return words_are_big_endian ? big : __builtin_bswap32(big);
    };
    for (size_t i = 0; i + 8 <= bytes.size(); i += 8) {
      first += word(&bytes[i]) + second;
      second += word(&bytes[i + 4]) + first;
    }
  }
  bool is(const uint8_t* stored) const {
    return first == big_endian(stored) && second == big_endian(stored + 4);
  }
};

struct Defect {
  uint64_t offset = 0;  // of the first corrupt frame [bytes]
  int64_t steps = 0;
};

std::optional<Defect> find_defect(const std::filesystem::path& path) {
  FileCursor file(path);
  if (file.size() < kHeaderBytes) return std::nullopt;
  std::array<uint8_t, kHeaderBytes> header{};
  file.read(header.data(), header.size());
  const uint32_t page = big_endian(&header[8]);
  if (page < 512 || page > 65536 || (page & (page - 1)) != 0) return Defect{0, 2};
  Checksum32 sum{.words_are_big_endian = (header[3] & 1) != 0};
  sum.add(std::span(header).first(24));
  std::optional<Defect> defect;
  if (!sum.is(&header[24])) defect.emplace();
  std::vector<uint8_t> frame(kFrameHeaderBytes + page);
  for (uint64_t at = kHeaderBytes; at + frame.size() <= file.size(); at += frame.size()) {
    file.read(frame.data(), frame.size());
    const bool of_this_log = std::equal(&frame[8], &frame[16], &header[16]);
    sum.add(std::span(frame).first(8));
    sum.add(std::span(frame).subspan(kFrameHeaderBytes));
    if (!defect && (!of_this_log || !sum.is(&frame[16]))) defect.emplace(Defect{at, 0});
    if (defect && of_this_log && big_endian(&frame[4]) != 0) ++defect->steps;
  }
  return defect;
}

}  // namespace

void check_log(const std::filesystem::path& log, const std::string& name) {
  if (!std::filesystem::exists(log)) return;
  // A writer may be appending frames: unfinished ones are valid at the second attempt.
  if (const auto seen = find_defect(log); !seen || seen->steps < 2) return;
  const auto defect = find_defect(log);
  if (!defect || defect->steps < 2) return;
  throw InputError(
      name, "-wal: corrupt at byte ", defect->offset, "; ", defect->steps,
      " transactions after it cannot be read; restore a copy of the map, or move this file "
      "away to continue without them");
}

}  // namespace revisit
