#pragma once

#include <string>

namespace revisit {

/// A number with as many digits as it takes to read it back unchanged.
std::string exact(double value);

/// A name for a text of any length, 16 hexadecimal digits. It does not protect: where it matters
/// the whole text is compared.
std::string short_name_of(const std::string& text);

}  // namespace revisit
