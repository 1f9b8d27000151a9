#pragma once

#include <chrono>
#include <string>

namespace revisit::pipeline::postgres {

/// Where a map on a server is, taken apart.
struct Address {
  std::string url;       // for libpq, which does not know map= and patience=
  std::string name;      // for people: without the password
  std::string password;  // as the address has it
  std::string map = "revisit";
  std::chrono::milliseconds patience{10'000};  // with a server that was there before
};

/// Throws UsageError.
Address parse_address(const std::string& where);

}  // namespace revisit::pipeline::postgres
