#include "revisit/proto/net_file.h"

#include <google/protobuf/text_format.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <limits>
#include <string_view>

#include "net_text.h"
#include "revisit/proto/atomic_file.h"
#include "upgrade.h"

namespace revisit::proto {
namespace {

namespace fs = std::filesystem;

// Hundreds of times the longest known network; text costs up to 100 times its size in memory.
constexpr size_t kLargestText = 16 << 20;  // [bytes]

std::string read_text(const fs::path& file) {
  std::error_code ignored;
  if (fs::is_directory(file, ignored))
    throw InputError(str(file.string(), ": is a folder, expected a prototxt"));
  errno = 0;
  std::ifstream in(file, std::ios::binary);
  if (!in)
    throw InputError(str(file.string(), ": cannot open: ", std::strerror(errno ? errno : EIO)));
  std::string text;
  std::vector<char> chunk(1 << 16);
  while (in && text.size() <= kLargestText) {
    in.read(chunk.data(), static_cast<std::streamsize>(chunk.size()));
    text.append(chunk.data(), static_cast<size_t>(in.gcount()));
  }
  if (in.bad())
    throw InputError(str(file.string(), ": cannot read: ", std::strerror(errno ? errno : EIO)));
  return text;
}

/// Says plainly what was given in a prototxt's place.
void check_is_text(const std::string& text, const std::string& name) {
  const std::string_view head = std::string_view(text).substr(0, 4096);
  const char* found = nullptr;
  if (text.empty()) {
    found = "is empty";
  } else if (head.starts_with("\x89HDF")) {
    found = "looks like an HDF5 weights file";
  } else if (std::ranges::any_of(head, [](char c) {
               return (c >= 0 && c < ' ' && !std::strchr("\t\n\v\f\r", c)) || c == '\0';
             })) {
    found = "looks like a binary caffemodel";
  }
  if (found) throw InputError(str(name, ": ", found, ", expected a prototxt (text)"));
  if (head.starts_with("\xEF\xBB\xBF")) {
    throw InputError(
        str(name, ":1:1: starts with a byte order mark; save it as UTF-8 without one"));
  }
  if (text.size() > kLargestText) {
    throw InputError(
        str(name, ": is larger than ", kLargestText >> 20, " MB; no network description is"));
  }
}

void check_writable(const fs::path& file, const caffe::NetParameter& net) {
  if (!net.IsInitialized()) {
    throw Error(
        str(file.string(), ": cannot write a net without ", net.InitializationErrorString()));
  }
}

}  // namespace

NetFile parse_net(const std::string& text, const std::string& name, const NetReadOptions& options) {
  check_is_text(text, name);
  NetFile result;
  result.net = parse_net_text(text, name, options.allow_unknown_fields, result.warnings);
  std::vector<std::string> notes;
  try {
    upgrade(result.net, notes);
  } catch (const UpgradeError& error) {
    throw InputError(message_start(name, locate(text, error.field, error.index)) + error.what());
  }
  for (const std::string& note : notes) result.warnings.push_back(str(name, ": ", note));
  if (result.net.layer_size() == 0) throw InputError(str(name, ": describes no layers"));
  return result;
}

NetFile read_net(const fs::path& prototxt, const NetReadOptions& options) {
  return parse_net(read_text(prototxt), prototxt.string(), options);
}

void write_net_text(const fs::path& file, const caffe::NetParameter& net) {
  check_writable(file, net);
  std::string text;
  if (!google::protobuf::TextFormat::PrintToString(net, &text)) {
    throw Error(str(file.string(), ": cannot write the net as text"));
  }
  write_atomically(file, [&](std::ostream& out) { out << text; });
}

void write_net_binary(const fs::path& file, const caffe::NetParameter& net) {
  check_writable(file, net);
  const size_t size = net.ByteSizeLong();
  if (size > static_cast<size_t>(std::numeric_limits<int32_t>::max())) {
    throw Error(str(file.string(), ": the net takes ", size, " bytes, protobuf allows 2^31-1"));
  }
  write_atomically(file, [&](std::ostream& out) {
    if (!net.SerializeToOstream(&out)) out.setstate(std::ios::failbit);
  });
}

}  // namespace revisit::proto
