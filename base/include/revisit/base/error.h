#pragma once

#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace revisit {

/// Base of every error this project throws on purpose. `what()` is one complete message for a
/// person: where, what was expected, what was found, what to do.
class Error : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The caller asked for something impossible: an unknown layer name, a bad option value.
/// (Exit code 2.)
class UsageError : public Error {
  using Error::Error;
};

/// A file is missing, unreadable, malformed, or does not fit the others. The message starts with
/// `path:line:column:` for text or `path:` and a byte offset for binary. (Exit code 3.)
class InputError : public Error {
  using Error::Error;
};

/// A well-formed model that needs something we do not have; the message names the layer and its
/// type. (Exit code 4.)
class UnsupportedError : public Error {
  using Error::Error;
};

/// The work was stopped by the user between two units of work; what was done is kept.
/// (Exit code 130.)
class Interrupted : public Error {
  using Error::Error;
};

/// Concatenates its arguments as an output stream would print them.
template <class... Parts>
std::string str(const Parts&... parts) {
  std::ostringstream out;
  (out << ... << parts);
  return std::move(out).str();
}

/// The candidate nearest to `wanted` in edit distance, or "" when none is near enough to be a
/// likely misspelling. For "did you mean" hints.
std::string nearest_name(std::string_view wanted, const std::vector<std::string>& candidates);

/// " (did you mean 'X'?)", or "" when no candidate is near.
std::string did_you_mean(std::string_view wanted, const std::vector<std::string>& candidates);

}  // namespace revisit
