#include "journal.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <fstream>
#include <string_view>
#include <vector>

namespace revisit::pipeline {
namespace {

constexpr size_t kHeader = 32, kFrameHeader = 24, kLongestPage = 65536;  // [bytes]

uint32_t big_endian(const char* at) {
  unsigned char b[4];
  std::memcpy(b, at, 4);
  return uint32_t{b[0]} << 24 | uint32_t{b[1]} << 16 | uint32_t{b[2]} << 8 | b[3];
}

struct WalChecksum {
  bool big = false;  // in which order the bytes of a word are summed
  uint32_t first = 0, second = 0;

  void add(const char* data, size_t size) {
    for (size_t i = 0; i + 8 <= size; i += 8) {
      first += word(data + i) + second;
      second += word(data + i + 4) + first;
    }
  }
  uint32_t word(const char* at) const {
    const uint32_t value = big_endian(at);
    return big ? value : __builtin_bswap32(value);
  }
  bool is_at(const char* at) const {
    return first == big_endian(at) && second == big_endian(at + 4);
  }
};

bool read(std::ifstream& in, std::vector<char>& bytes) {
  return static_cast<bool>(in.read(bytes.data(), static_cast<std::streamsize>(bytes.size())));
}

std::optional<JournalDamage> scan(const std::filesystem::path& journal, std::vector<char>& header) {
  std::ifstream in(journal, std::ios::binary);
  if (!read(in, header)) return std::nullopt;  // none, or nothing in it
  const uint32_t magic = big_endian(header.data());
  const size_t page = big_endian(header.data() + 8);
  WalChecksum checksum{.big = (magic & 1) != 0};
  checksum.add(header.data(), 24);
  if ((magic | 1) != 0x377F0683 || !checksum.is_at(header.data() + 24) || page < 512 ||
      page > kLongestPage)
    return JournalDamage{.at = 0, .lost_for_sure = false};

  std::vector<char> frame(kFrameHeader + page);
  std::optional<JournalDamage> damage;
  int frames_after = 0, steps_after = 0;  // a step's last frame has the size of the database
  for (int64_t at = kHeader; read(in, frame); at += static_cast<int64_t>(frame.size())) {
    // Behind the end of this log may be frames of one before it: both of their salts differ.
    if (!std::equal(&frame[8], &frame[12], &header[16]) &&
        !std::equal(&frame[12], &frame[16], &header[20]))
      break;
    checksum.add(frame.data(), 8);
    checksum.add(frame.data() + kFrameHeader, page);
    const bool sound = std::equal(&frame[8], &frame[16], &header[16]) && checksum.is_at(&frame[16]);
    if (damage) ++frames_after;
    if (!damage && !sound) damage = JournalDamage{.at = at};
    if (damage && big_endian(&frame[4]) != 0) ++steps_after;
  }
  // A long step that was taken back leaves frames behind the last step; they mean nothing.
  if (!damage || (steps_after == 0 && frames_after > 0)) return std::nullopt;
  // Each step waits until the one before it is on the disk.
  damage->lost_for_sure = steps_after > 1;
  return damage;
}

}  // namespace

std::optional<JournalDamage> journal_damage(const std::filesystem::path& journal) {
  // A frame that is being written looks like damage. The next look finds it whole, or another log.
  std::vector<char> header(kHeader), again(kHeader);
  std::optional<JournalDamage> damage = scan(journal, header);
  for (int looks = 0; damage && looks < 3; ++looks) {
    const std::optional<JournalDamage> second = scan(journal, again);
    if (second && second->at == damage->at && header == again) break;
    damage = second;
    header = again;
  }
  return damage;
}

bool names_a_file_to_remove(const std::filesystem::path& rollback_journal) {
  constexpr std::string_view kAtTheEnd = "\xd9\xd5\x05\xf9\x20\xa1\x63\xd7";
  std::ifstream in(rollback_journal, std::ios::binary);
  in.seekg(-static_cast<std::streamoff>(kAtTheEnd.size()), std::ios::end);
  std::string end(kAtTheEnd.size(), '\0');
  return in.read(end.data(), static_cast<std::streamsize>(end.size())) && end == kAtTheEnd;
}

}  // namespace revisit::pipeline
