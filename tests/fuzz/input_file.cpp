#include <sys/mman.h>
#include <unistd.h>

#include "fuzz.h"

namespace revisit::fuzz {

namespace fs = std::filesystem;

InputFile::InputFile(const std::string& bytes, const std::string& extension)
    : descriptor_(::memfd_create("fuzz", MFD_CLOEXEC)) {
  const ssize_t written = ::write(descriptor_, bytes.data(), bytes.size());
  require(written == static_cast<ssize_t>(bytes.size()), "the case can be written to memory");
  path_ = "/proc/self/fd/" + std::to_string(descriptor_);
  if (extension.empty()) return;
  const fs::path link =
      fs::temp_directory_path() / ("revisit_fuzz_" + std::to_string(::getpid()) + extension);
  std::error_code ignored;
  fs::remove(link, ignored);
  fs::create_symlink(path_, link);
  path_ = link;
  is_link_ = true;
}

InputFile::~InputFile() {
  std::error_code ignored;
  if (is_link_) fs::remove(path_, ignored);
  ::close(descriptor_);
}

}  // namespace revisit::fuzz
