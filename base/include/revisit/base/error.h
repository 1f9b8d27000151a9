#pragma once

#include <concepts>
#include <functional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace revisit {

/// Concatenates its arguments as an output stream would print them.
template <class... Parts>
std::string str(const Parts&... parts) {
  std::ostringstream out;
  (out << ... << parts);
  return std::move(out).str();
}

/// An option or function of the C++ interface that the message of an error names, e.g.
/// {"LoadOptions::inputs"}. A program can print its own name instead: Error::message().
struct CppName {
  std::string_view name;
};
inline std::ostream& operator<<(std::ostream& out, CppName cpp) {
  return out << cpp.name;
}

/// Base of every error this project throws on purpose. `what()` is one complete message for a
/// person: where, what was expected, what was found, what to do.
class Error : public std::runtime_error {
 public:
  using Words = std::function<std::string(const std::string& name)>;

  explicit Error(const std::string& message);
  explicit Error(const char* message);
  /// The message is all parts, as an output stream prints them; an Error stands for its message.
  template <class... Parts>
  explicit Error(const Parts&... parts) : Error(Pieces(parts...)) {}

  /// The message with `word(name)` in the place of each CppName.
  std::string message(const Words& word) const { return pieces_.text(word); }

 private:
  struct Piece {
    std::string text;
    bool is_name;  // a CppName
  };
  struct Pieces : std::vector<Piece> {
    template <class... Parts>
    explicit Pieces(const Parts&... parts) {
      (add(parts), ...);
    }
    template <class Part>
    void add(const Part& part) {
      if constexpr (std::derived_from<Part, Error>)
        insert(end(), part.pieces_.begin(), part.pieces_.end());
      else
        push_back({str(part), std::same_as<Part, CppName>});
    }
    std::string text(const Words& word) const;
  };
  explicit Error(Pieces&& pieces);

  Pieces pieces_;
};

/// The caller asked for something impossible: an unknown layer, a bad option value (exit code 2).
class UsageError : public Error {
  using Error::Error;
};

/// A file is missing, unreadable, malformed, or does not fit the others. The message starts with
/// `path:line:column:` for text or `path:` and a byte offset for binary. (Exit code 3.)
class InputError : public Error {
  using Error::Error;
};

/// A valid model needs something we do not have; the message names layer and type (exit code 4).
class UnsupportedError : public Error {
  using Error::Error;
};

/// The user stopped the work between two units of it; what was done is kept (exit code 130).
class Interrupted : public Error {
  using Error::Error;
};

/// The candidate that `wanted` is in another case, else the nearest in edit distance; "" where none
/// is as near as a third of its letters. Neighbours that changed places are one edit.
std::string nearest_name(std::string_view wanted, const std::vector<std::string>& candidates);

/// " (did you mean 'X'?)", or "" when no candidate is near.
std::string did_you_mean(std::string_view wanted, const std::vector<std::string>& candidates);
/// The same of a name that may be right elsewhere: for one that is wrong by a letter or two. The
/// last letters, `common` in number, tell nothing.
std::string did_you_misspell(std::string_view wanted, const std::vector<std::string>& candidates,
                             size_t common = 0);

}  // namespace revisit
