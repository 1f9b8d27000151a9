#pragma once

#include <chrono>
#include <string>

namespace revisit::postgres {

struct Address {
  std::string url;   // for libpq, without map= and patience=, which it does not know
  std::string name;  // for messages: without the password
  std::string password;
  std::string map = "revisit";
  std::chrono::milliseconds patience{10'000};  // maximum time to reconnect after a lost connection
};

Address parse_address(const std::string& where);

}  // namespace revisit::postgres
