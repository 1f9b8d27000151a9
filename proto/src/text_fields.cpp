#include "text_fields.h"

#include <algorithm>

#include "revisit/proto/limits.h"

namespace revisit::proto {
namespace {

constexpr std::string_view kBlanks = " \t\n\v\f\r";
constexpr std::string_view kDelimiters = " \t\n\v\f\r{}<>[],;:#'\"";

/// Scanner; its methods return false if the text does not match.
class Walk {
 public:
  Walk(std::string_view text, size_t begin, size_t end) : text_(text.substr(0, end)), at_(begin) {}

  size_t at() const { return at_; }
  char next() const { return at_ < text_.size() ? text_[at_] : '\0'; }
  bool ended() const { return at_ >= text_.size(); }

  void skip_space() {
    for (;;) {
      at_ = std::min(text_.find_first_not_of(kBlanks, at_), text_.size());
      if (next() != '#') return;
      at_ = std::min(text_.find('\n', at_), text_.size());
    }
  }

  bool take(char wanted) {
    if (next() != wanted) return false;
    ++at_;
    return true;
  }

  std::string_view word() {
    const size_t begin = at_;
    at_ = std::min(text_.find_first_of(kDelimiters, at_), text_.size());
    return text_.substr(begin, at_ - begin);
  }

  /// Reads a word, or the name of an extension in brackets.
  std::string_view name() {
    if (next() != '[') return word();
    const size_t begin = at_;
    return brackets() ? text_.substr(begin, at_ - begin) : "";
  }

  bool value() {
    if (next() == '{' || next() == '<' || next() == '[') return brackets();
    if (next() != '"' && next() != '\'') return number();
    while (next() == '"' || next() == '\'') {  // adjacent strings are concatenated
      if (!quoted()) return false;
      end_ = at_;
      skip_space();
    }
    return true;
  }

  /// End of the last value, before trailing space.
  size_t value_end() const { return end_; }

 private:
  bool number() {
    if (take('-')) skip_space();
    const bool found = !word().empty();
    end_ = at_;
    return found;
  }

  bool quoted() {
    const char quote = text_[at_];
    for (++at_; at_ < text_.size(); ++at_) {
      if (text_[at_] == '\\') {
        ++at_;
      } else if (text_[at_] == quote) {
        ++at_;
        return true;
      }
    }
    return false;
  }

  bool brackets() {
    char closing[kMaxNesting];
    size_t depth = 0;
    do {
      skip_space();
      if (ended()) return false;
      if (next() == '"' || next() == '\'') {
        if (!quoted()) return false;
        continue;
      }
      constexpr std::string_view kOpening = "{<[", kClosing = "}>]";
      const size_t kind = kOpening.find(next());
      if (kind != std::string_view::npos) {
        if (depth == std::size(closing)) return false;
        closing[depth++] = kClosing[kind];
      } else if (kClosing.find(next()) != std::string_view::npos) {
        if (depth == 0 || next() != closing[--depth]) return false;
      }
      ++at_;
    } while (depth > 0);
    end_ = at_;
    return true;
  }

  std::string_view text_;
  size_t at_, end_ = 0;
};

}  // namespace

std::optional<std::vector<TextField>> text_fields(std::string_view text, size_t begin, size_t end) {
  std::vector<TextField> fields;
  Walk walk(text, begin, end);
  for (walk.skip_space(); !walk.ended(); walk.skip_space()) {
    TextField field;
    field.begin = walk.at();
    field.name = walk.name();
    walk.skip_space();
    const bool has_colon = walk.take(':');
    walk.skip_space();
    field.value = walk.at();
    field.opens = walk.next();
    if (field.name.empty() || !(has_colon || field.opens == '{' || field.opens == '<') ||
        !walk.value())
      return std::nullopt;
    field.end = walk.value_end();
    fields.push_back(field);
    walk.skip_space();
    if (!walk.take(',')) walk.take(';');
  }
  return fields;
}

}  // namespace revisit::proto
