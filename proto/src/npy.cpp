#include "revisit/proto/npy.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <limits>
#include <optional>
#include <string_view>

#include "revisit/base/files.h"
#include "revisit/base/text.h"

static_assert(std::endian::native == std::endian::little, "arrays are stored little-endian");

namespace revisit::proto {
namespace {

// The format: https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html
constexpr std::string_view kMagic = "\x93NUMPY";
constexpr size_t kNumpyMostAxes = 64;  // NumPy's limit
constexpr size_t kAlignment = 64;      // [bytes]

struct Header {
  std::string dtype;  // NumPy's notation, e.g. "<f4"
  bool fortran_order;
  std::vector<int64_t> shape;
};

/// The header's Python dictionary: `{'descr': '<f4', 'fortran_order': False, 'shape': (1, 3), }`.
class HeaderParser {
 public:
  HeaderParser(std::string_view text, const std::string& path) : text_(text), path_(path) {}

  Header parse() {
    std::optional<std::string> dtype;
    std::optional<bool> fortran_order;
    std::optional<std::vector<int64_t>> shape;
    expect('{');
    while (!accept('}')) {
      const std::string key = parse_string();
      expect(':');
      if (key == "descr") {
        if (peek() != '\'' && peek() != '"') fail("dtype is a structure, expected float32 ('<f4')");
        dtype = parse_string();
      } else if (key == "fortran_order") {
        fortran_order = parse_bool();
      } else if (key == "shape") {
        shape = parse_shape();
      } else {
        fail("unknown header key '", key, "'");
      }
      if (!accept(',') && peek() != '}') fail("malformed header");
    }
    if (peek() != '\0') fail("malformed header");
    if (!dtype || !fortran_order || !shape) fail("the header lacks descr, fortran_order or shape");
    return {*dtype, *fortran_order, *shape};
  }

 private:
  template <class... Parts>
  [[noreturn]] void fail(const Parts&... reason) const {
    throw InputError(path_, ": ", reason...);
  }
  char peek() {
    const size_t at = text_.find_first_not_of(" \t\r\n");
    text_.remove_prefix(at == std::string_view::npos ? text_.size() : at);
    return text_.empty() ? '\0' : text_.front();
  }
  bool accept(char c) {
    if (peek() != c) return false;
    text_.remove_prefix(1);
    return true;
  }
  void expect(char c) {
    if (!accept(c)) fail("malformed header");
  }
  std::string parse_string() {
    const char quote = peek();
    if (quote != '\'' && quote != '"') fail("malformed header");
    const size_t end = text_.find(quote, 1);
    if (end == std::string_view::npos) fail("malformed header");
    std::string value(text_.substr(1, end - 1));
    text_.remove_prefix(end + 1);
    return value;
  }
  bool parse_bool() {
    peek();
    for (const std::string_view word : {"True", "False"}) {
      if (!text_.starts_with(word)) continue;
      text_.remove_prefix(word.size());
      return word == "True";
    }
    fail("fortran_order is neither True nor False");
  }
  std::vector<int64_t> parse_shape() {
    std::vector<int64_t> dims;
    expect('(');
    while (!accept(')')) {
      peek();
      int64_t dim = 0;
      const auto [end, error] = std::from_chars(text_.data(), text_.data() + text_.size(), dim);
      if (error != std::errc() || dim < 0) fail("invalid dimension in the shape");
      text_.remove_prefix(static_cast<size_t>(end - text_.data()));
      accept('L');  // Python 2
      if (dims.size() == kNumpyMostAxes) fail("more than ", kNumpyMostAxes, " axes");
      dims.push_back(dim);
      if (!accept(',') && peek() != ')') fail("malformed header");
    }
    return dims;
  }

  std::string_view text_;
  const std::string& path_;
};

std::string read_dictionary(FileCursor& cursor, const std::string& path) {
  std::array<unsigned char, 8> start{};  // magic, major and minor version
  const bool has_start = cursor.size() >= start.size() + 2;
  if (has_start) cursor.read(start.data(), start.size());
  if (!has_start ||
      !std::equal(kMagic.begin(), kMagic.end(), start.begin(),
                  [](char a, unsigned char b) { return static_cast<unsigned char>(a) == b; }))
    throw InputError(path, ": is not a NumPy .npy file (no \\x93NUMPY at its beginning)");
  const int version = start[6];
  if (version < 1 || version > 3)
    throw InputError(path, ": .npy version ", version, ", expected 1, 2 or 3");
  uint64_t length = 0;
  const int length_bytes = version == 1 ? 2 : 4;
  for (int i = 0; i < length_bytes && cursor.position() < cursor.size(); ++i)
    length |= static_cast<uint64_t>(cursor.read_byte()) << (8 * i);
  if (length > kMaxNpyHeader || length > cursor.size() - cursor.position())
    throw InputError(path, ": byte 8: header of ", length, " bytes, but only ",
                     cursor.size() - cursor.position(), " bytes follow (limit ", kMaxNpyHeader,
                     ")");
  std::string header(length, '\0');
  cursor.read(header.data(), length);
  return header;
}

/// Returns the number of elements.
uint64_t check_size(const FileCursor& cursor, const Header& header, uint64_t item_bytes) {
  const uint64_t available = cursor.size() - cursor.position();
  uint64_t count = 1;
  bool overflows = false;
  for (const int64_t dim : header.shape)
    overflows |= __builtin_mul_overflow(count, static_cast<uint64_t>(dim), &count);
  // An empty array (a dimension 0) cannot overflow.
  if (std::ranges::find(header.shape, 0) != header.shape.end()) count = 0, overflows = false;
  if (overflows || count > std::numeric_limits<uint64_t>::max() / item_bytes ||
      count * item_bytes != available)
    throw InputError(cursor.file().string(), ": shape ", shape_text(header.shape), " of '",
                     header.dtype, "' does not fit the ", available,
                     " bytes after the header (is the file truncated?)");
  return count;
}

/// Float32 or, if `or_doubles`, float64 in C order; leaves the cursor at the array.
Header read_header(FileCursor& cursor, bool or_doubles) {
  const std::string path = cursor.file().string(), text = read_dictionary(cursor, path);
  Header header = HeaderParser(text, path).parse();
  if (header.dtype != "<f4" && !(or_doubles && header.dtype == "<f8"))
    throw InputError(path, ": dtype '", header.dtype, "', expected little-endian float32 ('<f4')",
                     or_doubles ? " or float64 ('<f8')" : "", "; save array.astype('<f4')");
  if (header.fortran_order)
    throw InputError(path,
                     ": Fortran order, expected C order; save numpy.ascontiguousarray(array)");
  return header;
}

}  // namespace

std::vector<int64_t> read_npy_header(FileCursor& cursor) {
  return read_header(cursor, false).shape;
}

Blob read_npy(const std::filesystem::path& file) {
  FileCursor cursor(file);
  const Header header = read_header(cursor, true);
  const bool single = header.dtype == "<f4";
  const uint64_t count = check_size(cursor, header, single ? sizeof(float) : sizeof(double));
  Blob array{.shape = header.shape, .data = std::vector<float>(count)};
  if (single) {
    cursor.read(array.data.data(), count * sizeof(float));
    return array;
  }
  for (float& value : array.data) {
    double wide = 0;
    cursor.read(&wide, sizeof wide);
    value = static_cast<float>(wide);
  }
  return array;
}

std::string npy_header(const std::vector<int64_t>& shape) {
  std::string dims = joined(shape, ", ");
  if (shape.size() == 1) dims += ",";  // a Python tuple of one
  std::string dictionary = "{'descr': '<f4', 'fortran_order': False, 'shape': (" + dims + "), }";
  const size_t fixed = kMagic.size() + 2 + 2;  // magic, version, length
  const size_t unpadded = fixed + dictionary.size() + 1;
  dictionary.append((kAlignment - unpadded % kAlignment) % kAlignment, ' ');
  dictionary += '\n';
  if (shape.size() > kNumpyMostAxes)
    throw UsageError("array of ", shape.size(), " axes (NumPy's limit is 64)");

  std::string header(kMagic);
  header += {'\x01', '\x00'};
  header += static_cast<char>(dictionary.size() & 0xff);
  header += static_cast<char>(dictionary.size() >> 8);
  return header + dictionary;
}

void write_npy(const std::filesystem::path& file, const std::vector<int64_t>& shape,
               const float* data) {
  std::streamsize bytes = sizeof(float);
  for (const int64_t dim : shape)
    if (dim < 0 || __builtin_mul_overflow(bytes, dim, &bytes))
      throw UsageError(file.string(), ": cannot hold an array of shape ", shape_text(shape));
  const std::string header = npy_header(shape);
  write_atomically(file, [&](std::ostream& out) {
    out << header;
    out.write(reinterpret_cast<const char*>(data), bytes);
  });
}

}  // namespace revisit::proto
