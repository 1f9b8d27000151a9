#include "postgres_map.h"
#include "revisit/proto/error.h"

// Stands for postgres/*.cpp in a build without libpqxx.

namespace revisit::pipeline {
namespace {

[[noreturn]] void fail() {
  throw UsageError(
      "a map on a PostgreSQL server: this program was built without libpqxx; install libpqxx-dev "
      "and build it with -DREVISIT_POSTGRES=ON");
}

}  // namespace

std::unique_ptr<MapStore> open_postgres_map(const std::string&, MapAccess, const MapIdentity*,
                                            NumberFormat) {
  fail();
}

std::vector<std::string> check_postgres_map(const std::string&) {
  fail();
}

}  // namespace revisit::pipeline
