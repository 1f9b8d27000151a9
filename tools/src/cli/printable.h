#pragma once

#include <memory>
#include <ostream>
#include <string>
#include <string_view>

namespace revisit::cli {

/// Escapes control characters and bytes outside of UTF-8 for a terminal, as \x1b.
std::string printable(std::string_view text);

/// Replaces bytes outside of UTF-8 by U+FFFD.
std::string utf8(std::string_view text);

/// Makes all output of a stream printable during its lifetime, but for line ends and tabs. For
/// messages and terminals; files and pipes get the exact bytes.
class PrintableStream {
 public:
  explicit PrintableStream(std::ostream& stream);
  ~PrintableStream();
  PrintableStream(const PrintableStream&) = delete;
  PrintableStream& operator=(const PrintableStream&) = delete;

 private:
  class Buffer;
  std::ostream& stream_;
  std::unique_ptr<Buffer> buffer_;
  std::streambuf* before_;
};

}  // namespace revisit::cli
