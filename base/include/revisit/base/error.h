#pragma once

#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace revisit {

/// Concatenates the parts as an ostream prints them.
template <class... Parts>
std::string str(const Parts&... parts) {
  std::ostringstream out;
  (out << ... << parts);
  return std::move(out).str();
}

/// Base of all errors that this project throws deliberately. `what()` is a complete message for the
/// user: where, what was expected, what was found, how to fix it.
class Error : public std::runtime_error {
 public:
  /// Concatenates the parts; an Error contributes its message.
  template <class... Parts>
  explicit Error(const Parts&... parts) : std::runtime_error(str(parts...)) {}

  /// Writes what().
  friend std::ostream& operator<<(std::ostream& out, const Error& error) {
    return out << error.what();
  }
};

/// Invalid request of the caller, e.g. an unknown layer or a bad option value (exit code 2).
class UsageError : public Error {
  using Error::Error;
};

/// A file is missing, unreadable, malformed, or inconsistent with others (exit code 3). The message
/// starts with `path:line:column:` for text, with `path:` and a byte offset for binary files.
class InputError : public Error {
  using Error::Error;
};

/// A valid model needs an unsupported feature; the message names layer and type (exit code 4).
class UnsupportedError : public Error {
  using Error::Error;
};

/// The user interrupted the work; finished units are kept (exit code 130).
class Interrupted : public Error {
  using Error::Error;
};

/// Returns the candidate that differs from `wanted` in case only, else the nearest by edit
/// distance. Returns "" if the distance exceeds a third of the length. A transposition is one edit.
std::string nearest_name(std::string_view wanted, const std::vector<std::string>& candidates);

/// Returns " (did you mean 'X'?)", or "" if no candidate is near.
std::string nearest_name_hint(std::string_view wanted, const std::vector<std::string>& candidates);
/// Like nearest_name_hint(), but accepts at most two edits, because `wanted` may be valid
/// elsewhere. The last `common` letters do not count for the length.
std::string misspelling_hint(std::string_view wanted, const std::vector<std::string>& candidates,
                             size_t common = 0);

}  // namespace revisit
