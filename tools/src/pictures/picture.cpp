#include "pictures/picture.h"

#include <png.h>

#include <algorithm>
#include <csetjmp>
#include <cstdio>
#include <cstring>
#include <string>
// After cstdio, which it needs.
#include <jpeglib.h>

#include "cli/terminal.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"

namespace revisit::cli {

namespace {

/// Bytes of a TIFF file, the format of EXIF; bytes beyond its end are 0.
struct Tiff {
  std::string_view bytes;

  uint32_t number(size_t at, size_t size) const {
    const bool is_little_endian = bytes.starts_with("II");
    uint32_t value = 0;
    for (size_t i = 0; i < size; ++i) {
      const size_t place = at + (is_little_endian ? size - 1 - i : i);
      value = value << 8 | (place < bytes.size() ? static_cast<uint8_t>(bytes[place]) : 0);
    }
    return value;
  }
};

/// Target of a library's longjmp on failure, which must not skip destructors.
struct Failure {
  std::jmp_buf leave;
  char message[JMSG_LENGTH_MAX] = "";
};

Picture make_picture(int64_t width, int64_t height, int channels) {
  if (width * height > Picture::kMaxPixels)
    throw InputError(width, " x ", height, " pixels; pictures of up to ", Picture::kMaxPixels,
                     " pixels are read");
  return {static_cast<int>(width), static_cast<int>(height), channels,
          std::vector<uint8_t>(static_cast<size_t>(width * height * channels))};
}

class Png {
 public:
  explicit Png(const std::string& bytes)
      : left_(bytes), png_(png_create_read_struct(PNG_LIBPNG_VER_STRING, &failure_, fail, ignore)) {
    info_ = png_create_info_struct(png_);
    if (!info_) throw Error("libpng has no memory");
    png_set_read_fn(png_, &left_, take);
    png_set_user_limits(png_, PNG_UINT_31_MAX, PNG_UINT_31_MAX);
  }
  ~Png() { png_destroy_read_struct(&png_, &info_, nullptr); }
  Png(const Png&) = delete;
  Png& operator=(const Png&) = delete;

  Picture read(int channels) {
    if (!read_header()) throw InputError("not a PNG picture: ", failure_.message);
    Picture picture =
        make_picture(png_get_image_width(png_, info_), png_get_image_height(png_, info_), channels);
    for (int64_t y = 0; y < picture.height; ++y)
      rows_.push_back(&picture.pixels[y * picture.width * channels]);
    if (!read_rows(channels == 1))
      throw InputError("the PNG picture is corrupt: ", failure_.message);
    return picture;
  }

 private:
  static void fail(png_structp png, png_const_charp message) {
    auto& failure = *static_cast<Failure*>(png_get_error_ptr(png));
    std::snprintf(failure.message, sizeof failure.message, "%s", message);
    std::longjmp(failure.leave, 1);
  }
  static void ignore(png_structp, png_const_charp) {}
  static void take(png_structp png, png_bytep out, size_t count) {
    auto& left = *static_cast<std::string_view*>(png_get_io_ptr(png));
    if (left.size() < count) png_error(png, "it ends too early");
    std::memcpy(out, left.data(), count);
    left.remove_prefix(count);
  }

  bool read_header() {
    if (setjmp(failure_.leave)) return false;
    png_read_info(png_, info_);
    return true;
  }
  bool read_rows(bool gray) {
    if (setjmp(failure_.leave)) return false;
    png_set_expand(png_);
    png_set_strip_16(png_);
    png_set_strip_alpha(png_);
    if (gray) {
      // Gamma is kept, but weighs the colors of a gray picture.
      png_set_rgb_to_gray(png_, PNG_ERROR_ACTION_NONE, 0.299, 0.587);
    } else {
      png_set_gray_to_rgb(png_);
      png_set_bgr(png_);
    }
    png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
    png_read_image(png_, rows_.data());
    return true;
  }

  Failure failure_;
  std::string_view left_;
  png_structp png_;
  png_infop info_ = nullptr;
  std::vector<png_bytep> rows_;
};

class Jpeg {
 public:
  explicit Jpeg(const std::string& bytes) : bytes_(bytes) {
    jpeg_.err = jpeg_std_error(&errors_);
    jpeg_.client_data = this;
    errors_.error_exit = fail;
    errors_.emit_message = keep_warning;
  }
  ~Jpeg() { jpeg_destroy_decompress(&jpeg_); }
  Jpeg(const Jpeg&) = delete;
  Jpeg& operator=(const Jpeg&) = delete;

  /// `warnings`: those of libjpeg and EXIF.
  Picture read(int channels, std::vector<std::string>* warnings) {
    if (!read_header()) throw InputError("not a JPEG picture: ", failure_.message);
    warn_of_exif(warnings);
    Picture picture = make_picture(jpeg_.image_width, jpeg_.image_height, channels);
    if (!read_rows(&picture))
      throw InputError("the JPEG picture cannot be read: ", failure_.message);
    if (*failure_.message) warnings->emplace_back(failure_.message);
    return picture;
  }

 private:
  static Failure& failure_of(j_common_ptr jpeg) {
    return static_cast<Jpeg*>(jpeg->client_data)->failure_;
  }
  static void fail(j_common_ptr jpeg) {
    jpeg->err->format_message(jpeg, failure_of(jpeg).message);
    std::longjmp(failure_of(jpeg).leave, 1);
  }
  static void keep_warning(j_common_ptr jpeg, int level) {
    if (level < 0) jpeg->err->format_message(jpeg, failure_of(jpeg).message);
  }

  bool read_header() {
    if (setjmp(failure_.leave)) return false;
    jpeg_create_decompress(&jpeg_);
    jpeg_mem_src(&jpeg_, reinterpret_cast<const uint8_t*>(bytes_.data()), bytes_.size());
    jpeg_save_markers(&jpeg_, JPEG_APP0 + 1, 0xFFFF);
    jpeg_read_header(&jpeg_, TRUE);
    return true;
  }
  void warn_of_exif(std::vector<std::string>* warnings) const {
    int orientation = 1;
    for (auto* marker = jpeg_.marker_list; marker && orientation == 1; marker = marker->next)
      orientation =
          exif_orientation({reinterpret_cast<const char*>(marker->data), marker->data_length});
    if (orientation != 1)
      warnings->push_back(
          str("EXIF says that the picture is rotated or mirrored (orientation ", orientation,
              "): pixels are taken as stored, as OpenCV 2.4 did; OpenCV turns them since 3.1"));
  }
  bool read_rows(Picture* picture) {
    if (setjmp(failure_.leave)) return false;
    jpeg_.out_color_space = picture->channels == 1 ? JCS_GRAYSCALE : JCS_EXT_BGR;
    jpeg_start_decompress(&jpeg_);
    const size_t width = size_t{jpeg_.output_width} * picture->channels;
    while (jpeg_.output_scanline < jpeg_.output_height) {
      JSAMPROW at = &picture->pixels[jpeg_.output_scanline * width];
      jpeg_read_scanlines(&jpeg_, &at, 1);
    }
    jpeg_finish_decompress(&jpeg_);
    return true;
  }

  const std::string& bytes_;
  Failure failure_;
  jpeg_error_mgr errors_{};
  jpeg_decompress_struct jpeg_{};
};

struct Between {
  int64_t first = 0, second = 0;
  float weight = 0;  // of the second
};

/// Positions of the centers of `to` pixels among `from` pixels, as in OpenCV's resize().
std::vector<Between> stretched(int64_t from, int64_t to) {
  std::vector<Between> places;
  const double scale = static_cast<double>(from) / static_cast<double>(to);
  for (int64_t i = 0; i < to; ++i) {
    const double at = std::clamp((static_cast<double>(i) + 0.5) * scale - 0.5, 0.0,
                                 static_cast<double>(from - 1));
    const auto first = static_cast<int64_t>(at);
    places.push_back({first, std::min(first + 1, from - 1),
                      static_cast<float>(at - static_cast<double>(first))});
  }
  return places;
}

std::vector<float> plane_of(const Picture& picture, int64_t channel) {
  std::vector<float> plane;
  for (size_t i = channel; i < picture.pixels.size(); i += picture.channels)
    plane.push_back(picture.pixels[i]);
  return plane;
}

void stretch(const std::vector<float>& plane, int64_t width, const std::vector<Between>& rows,
             const std::vector<Between>& columns, std::vector<float>* out) {
  for (const Between& y : rows)
    for (const Between& x : columns) {
      const auto across = [&](int64_t row) {
        const float* const values = &plane[static_cast<size_t>(row * width)];
        return values[x.first] + x.weight * (values[x.second] - values[x.first]);
      };
      const float above = across(y.first);
      out->push_back(above + y.weight * (across(y.second) - above));
    }
}

}  // namespace

int exif_orientation(std::string_view marker) {
  constexpr std::string_view kExif{"Exif\0\0", 6};
  constexpr size_t kEntry = 12;
  constexpr uint32_t kVersion = 42, kOrientation = 0x0112, kShort = 3;
  if (!marker.starts_with(kExif)) return 1;
  const Tiff tiff{marker.substr(kExif.size())};
  if (tiff.number(2, 2) != kVersion) return 1;
  const size_t directory = tiff.number(4, 4);
  const size_t begin = directory + 2;
  const size_t end = std::min(begin + tiff.number(directory, 2) * kEntry, tiff.bytes.size());
  for (size_t entry = begin; entry < end; entry += kEntry) {
    const uint32_t value = tiff.number(entry + 8, 2);
    if (tiff.number(entry, 2) == kOrientation && tiff.number(entry + 2, 2) == kShort)
      return value >= 1 && value <= 8 ? static_cast<int>(value) : 1;
  }
  return 1;
}

Picture read_picture(const std::filesystem::path& file, int channels) {
  const std::string bytes = read_content(file);
  try {
    if (bytes.starts_with("\x89PNG")) return Png(bytes).read(channels);
    if (!bytes.starts_with("\xff\xd8")) throw InputError("not a picture: expected PNG or JPEG");
    std::vector<std::string> warnings;
    Picture picture = Jpeg(bytes).read(channels, &warnings);
    for (const std::string& warning : warnings) warn(str(file.string(), ": ", warning));
    return picture;
  } catch (const InputError& error) {
    throw InputError(file.string(), ": ", error);
  }
}

proto::Blob picture_input(const std::vector<std::filesystem::path>& files, const std::string& blob,
                          const engine::Shape& input, bool rgb) {
  if (input.rank() != 4 || (input[1] != 3 && input[1] != 1))
    throw UsageError("--image: the input '", blob, "' is ", input,
                     " (expected n x 3 x h x w, or n x 1 x h x w for gray)");
  const auto channels = static_cast<int>(input[1]);
  proto::Blob array;
  array.shape = input.with(0, static_cast<int64_t>(files.size())).axes();
  for (const std::filesystem::path& file : files) {
    const Picture picture = read_picture(file, channels);
    const auto rows = stretched(picture.height, input[2]);
    const auto columns = stretched(picture.width, input[3]);
    for (int c = 0; c < channels; ++c)
      stretch(plane_of(picture, rgb ? channels - 1 - c : c), picture.width, rows, columns,
              &array.data);
  }
  return array;
}

}  // namespace revisit::cli
