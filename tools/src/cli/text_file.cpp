#include "cli/text_file.h"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>

#include "revisit/proto/error.h"

namespace revisit::cli {

namespace fs = std::filesystem;

std::string read_text_file(const fs::path& file) {
  std::error_code error;
  const fs::file_status status = fs::status(file, error);
  if (fs::is_directory(status)) throw InputError(file.string() + ": is a folder, expected a file");
  if (fs::exists(status) && !fs::is_regular_file(status))
    throw InputError(file.string() + ": is not a regular file");
  errno = 0;
  std::ifstream in(file, std::ios::binary);
  std::ostringstream content;
  if (in.peek() != std::ifstream::traits_type::eof()) content << in.rdbuf();
  if (!in.is_open() || in.bad() || content.bad())
    throw InputError(
        str(file.string(), ": cannot read: ", errno ? std::strerror(errno) : "read error"));
  return std::move(content).str();
}

}  // namespace revisit::cli
