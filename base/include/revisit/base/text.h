#pragma once

#include <string>

namespace revisit {

/// Formats a number with the fewest digits that restore it exactly.
std::string exact(double value);

/// Returns a hash of the text, 16 hexadecimal digits. It is not cryptographic; compare the texts
/// where collisions matter.
std::string short_name_of(const std::string& text);

}  // namespace revisit
