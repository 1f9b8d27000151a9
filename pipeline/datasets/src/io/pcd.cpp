#include <liblzf/lzf.h>

#include <cstdint>
#include <cstring>
#include <optional>

#include "io/file_content.h"
#include "io/point_files.h"
#include "revisit/base/error.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

struct PcdHeader {
  PointTable table;
  std::string_view data;  // ascii | binary | binary_compressed
};

std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  for (std::string_view word; !(word = take_word(&line)).empty();) words.push_back(word);
  return words;
}

NumberType number_type(std::string_view type, std::string_view size, const std::string& where) {
  NumberType number;
  number.kind = type == "I" ? 'i' : type == "U" ? 'u' : type == "F" ? 'f' : '?';
  if (size.size() == 1) number.bytes = static_cast<size_t>(size[0] - '0');
  if (number_reader(number)) return number;
  throw InputError(where, ": unknown type: TYPE ", type.substr(0, 40), " of SIZE ",
                   size.substr(0, 40), "; expected I or U of 1, 2, 4, 8 or F of 4, 8");
}

/// Leaves `text` at the first byte of the points.
PcdHeader read_pcd_header(TextCursor* text) {
  std::vector<std::string_view> names, sizes, types, counts;
  std::optional<size_t> width, height, points;
  PcdHeader header;
  std::string_view line;
  while (header.data.empty()) {
    if (!text->next(&line)) throw InputError(text->name() + ": the PCD header has no line DATA");
    std::string_view values = line;
    const std::string_view key = take_word(&values);
    const std::string where = text->where();
    if (key.empty() || key.starts_with('#') || key == "VERSION" || key == "VIEWPOINT") continue;
    if (key == "FIELDS" || key == "COLUMNS") {
      names = words_of(values);
    } else if (key == "SIZE") {
      sizes = words_of(values);
    } else if (key == "TYPE") {
      types = words_of(values);
    } else if (key == "COUNT") {
      counts = words_of(values);
    } else if (key == "WIDTH") {
      width = parse_count(take_word(&values), where);
    } else if (key == "HEIGHT") {
      height = parse_count(take_word(&values), where);
    } else if (key == "POINTS") {
      points = parse_count(take_word(&values), where);
    } else if (key == "DATA") {
      header.data = take_word(&values);
      if (header.data != "ascii" && header.data != "binary" && header.data != "binary_compressed")
        throw InputError(where, ": expected DATA ascii, binary or binary_compressed, found '",
                         header.data.substr(0, 40), "'");
    } else {
      throw InputError(where, ": not a line of a PCD header: '", key.substr(0, 40), "'");
    }
  }

  const std::string where = text->where();
  if (sizes.size() != names.size() || types.size() != names.size() ||
      (!counts.empty() && counts.size() != names.size()))
    throw InputError(where, ": the header names ", names.size(), " FIELDS, but has ", sizes.size(),
                     " SIZE, ", types.size(), " TYPE, ", counts.size(), " COUNT values");
  for (size_t i = 0; i < names.size(); ++i)
    header.table.add(names[i], number_type(types[i], sizes[i], where),
                     counts.empty() ? 1 : parse_count(counts[i], where));
  header.table.check(where);

  if (!points && !width) throw InputError(where + ": the header has neither POINTS nor WIDTH");
  header.table.points = points ? *points : *width * height.value_or(1);
  if (width && *width * height.value_or(1) != header.table.points)
    throw InputError(where, ": WIDTH ", *width, " x HEIGHT ", height.value_or(1), " is not POINTS ",
                     header.table.points);
  return header;
}

std::string decompress(const PointTable& table, std::string_view body, const TextCursor& text) {
  uint32_t sizes[2];  // compressed, uncompressed [bytes]
  if (body.size() < sizeof sizes)
    throw InputError(text.where() + ": truncated: the sizes of the compressed data are missing");
  std::memcpy(sizes, body.data(), sizeof sizes);
  body.remove_prefix(sizeof sizes);
  const auto [compressed, uncompressed] = sizes;
  if (compressed > body.size())
    throw InputError(text.where(), ": truncated: expected ", compressed,
                     " compressed bytes, found ", body.size());
  if (uncompressed % table.row_bytes() != 0 || uncompressed / table.row_bytes() != table.points)
    throw InputError(text.where(), ": ", uncompressed, " uncompressed bytes are not ", table.points,
                     " points of ", table.row_bytes(), " bytes");
  // LZF copies at most 264 bytes for 3; a larger ratio is invalid and must not allocate memory.
  constexpr uint32_t kMaxRatio = 88;
  std::string bytes;
  if (uncompressed == 0) return bytes;
  if (uncompressed / kMaxRatio <= compressed && compressed > 0) {
    bytes.resize(uncompressed);
    if (lzf_decompress(body.data(), compressed, bytes.data(), uncompressed) == uncompressed)
      return bytes;
  }
  throw InputError(text.where(), ": the compressed data is corrupt");
}

}  // namespace

PointCloud read_pcd(const fs::path& file, RecordedTimes& times) {
  const std::string content = read_content(file);
  TextCursor text(content, file.string());
  const PcdHeader header = read_pcd_header(&text);
  const std::string_view body = text.rest();
  if (header.data == "binary") {
    // Divides, because a product could overflow.
    const size_t n = header.table.points, row = header.table.row_bytes();
    if (n > body.size() / row)
      throw InputError(text.where(), ": truncated: ", n, " points of ", row,
                       " bytes do not fit the ", body.size(), " bytes that follow");
    return header.table.decode(body.data(), PointTable::Layout::kRows, times);
  }
  if (header.data == "binary_compressed")
    return header.table.decode(decompress(header.table, body, text).data(),
                               PointTable::Layout::kColumns, times);

  PointCloud cloud = header.table.parse_rows(&text, times);
  for (std::string_view line; text.next(&line);)
    if (!take_word(&line).empty())
      throw InputError(text.where(), ": more lines than the ", header.table.points,
                       " points of the header");
  return cloud;
}

}  // namespace revisit
