#pragma once

#include <memory>
#include <ostream>
#include <string>
#include <string_view>

namespace revisit::cli {

/// Text of a file for a terminal: control characters and bytes outside UTF-8 become \x1b and alike.
std::string printable(std::string_view text);

/// UTF-8: bytes that are not become U+FFFD.
std::string utf8(std::string_view text);

/// Makes all that goes through a stream printable as long as it lives; line ends and tabulators
/// stay. For messages and for what a terminal shows: a machine reads the exact bytes.
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
