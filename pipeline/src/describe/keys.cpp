#include "describe/keys.h"

#include "revisit/proto/error.h"

namespace revisit::pipeline {

namespace fs = std::filesystem;

std::string short_name_of(const std::string& text) {
  uint64_t value = 0xCBF29CE484222325ULL;  // FNV-1a, 64 bit
  for (const unsigned char c : text) value = (value ^ c) * 0x100000001B3ULL;
  std::string digits(16, '0');
  for (size_t i = digits.size(); i-- > 0; value >>= 4) digits[i] = "0123456789abcdef"[value & 15];
  return digits;
}

std::string dataset_key(const Dataset& dataset) {
  std::string files;
  for (const ScanRef& scan : dataset.scans) {
    std::error_code error;
    const auto changed = fs::last_write_time(scan.file, error).time_since_epoch().count();
    files += str(fs::absolute(scan.file).string(), " ", fs::file_size(scan.file, error), " ",
                 changed, "\n");
  }
  return str("scans ", dataset.scans.size(), " ", short_name_of(files));
}

}  // namespace revisit::pipeline
