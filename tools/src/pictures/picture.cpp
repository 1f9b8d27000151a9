#include "pictures/picture.h"

#include <png.h>

#include <csetjmp>
#include <cstdio>
#include <cstring>
#include <string>
// After cstdio, which it needs.
#include <jpeglib.h>

#include "cli/messages.h"
#include "revisit/base/error.h"
#include "revisit/base/file_content.h"

namespace revisit::cli {
namespace {

constexpr int kChannels = 3;

/// Where a library leaves to when it fails. Its longjmp passes over functions without destructors.
struct Failure {
  std::jmp_buf leave;
  char message[JMSG_LENGTH_MAX] = "";
};

void check_size(int64_t width, int64_t height) {
  if (width * height > Picture::kMostPixels)
    throw InputError(width, " x ", height, " pixels; pictures of up to ", Picture::kMostPixels,
                     " pixels are read");
}

class Png {
 public:
  explicit Png(const std::string& bytes)
      : left_(bytes), png_(png_create_read_struct(PNG_LIBPNG_VER_STRING, &failure_, fail, ignore)) {
    info_ = png_create_info_struct(png_);
    if (!info_) throw Error("libpng has no memory");
    png_set_read_fn(png_, &left_, take);
    // Gamma is left as it is.
    png_set_user_limits(png_, PNG_UINT_31_MAX, PNG_UINT_31_MAX);
  }
  ~Png() { png_destroy_read_struct(&png_, &info_, nullptr); }
  Png(const Png&) = delete;
  Png& operator=(const Png&) = delete;

  Picture read() {
    if (!read_header()) throw InputError("not a PNG picture: ", failure_.message);
    const int64_t width = png_get_image_width(png_, info_);
    const int64_t height = png_get_image_height(png_, info_);
    check_size(width, height);
    Picture picture{static_cast<int>(width), static_cast<int>(height),
                    std::vector<uint8_t>(static_cast<size_t>(width * height * kChannels))};
    for (int64_t y = 0; y < height; ++y) rows_.push_back(&picture.bgr[y * width * kChannels]);
    if (!read_rows()) throw InputError("the PNG picture is damaged: ", failure_.message);
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
  bool read_rows() {
    if (setjmp(failure_.leave)) return false;
    png_set_expand(png_);
    png_set_strip_16(png_);
    png_set_strip_alpha(png_);
    png_set_gray_to_rgb(png_);
    png_set_bgr(png_);
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

  /// `warning` is what libjpeg passes over, "" for nothing.
  Picture read(std::string* warning) {
    if (!read_header()) throw InputError("not a JPEG picture: ", failure_.message);
    check_size(jpeg_.image_width, jpeg_.image_height);
    Picture picture{
        static_cast<int>(jpeg_.image_width), static_cast<int>(jpeg_.image_height),
        std::vector<uint8_t>(size_t{jpeg_.image_width} * jpeg_.image_height * kChannels)};
    if (!read_rows(picture.bgr.data()))
      throw InputError("the JPEG picture cannot be read: ", failure_.message);
    *warning = failure_.message;
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
    jpeg_read_header(&jpeg_, TRUE);
    return true;
  }
  bool read_rows(uint8_t* row) {
    if (setjmp(failure_.leave)) return false;
    jpeg_.out_color_space = JCS_EXT_BGR;
    jpeg_start_decompress(&jpeg_);
    while (jpeg_.output_scanline < jpeg_.output_height) {
      JSAMPROW at = row + size_t{jpeg_.output_scanline} * jpeg_.output_width * kChannels;
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

}  // namespace

Picture read_picture(const std::filesystem::path& file) {
  const std::string bytes = read_content(file);
  try {
    if (bytes.starts_with("\x89PNG")) return Png(bytes).read();
    if (!bytes.starts_with("\xff\xd8")) throw InputError("not a picture: expected PNG or JPEG");
    std::string warning;
    Picture picture = Jpeg(bytes).read(&warning);
    if (!warning.empty()) warn(str(file.string(), ": ", warning));
    return picture;
  } catch (const InputError& error) {
    throw InputError(file.string(), ": ", error);
  }
}

}  // namespace revisit::cli
