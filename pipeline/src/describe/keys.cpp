#include "describe/keys.h"

#include "revisit/pipeline/text.h"
#include "revisit/proto/error.h"

namespace revisit::pipeline {

namespace fs = std::filesystem;

std::string dataset_key(const Dataset& dataset) {
  std::string files;
  for (const ScanRef& scan : dataset.scans) {
    std::error_code error;
    const auto changed = fs::last_write_time(scan.file, error).time_since_epoch().count();
    files += str(fs::absolute(scan.file).string(), " ", fs::file_size(scan.file, error), " ",
                 changed, "\n");
  }
  return str("scans ", dataset.scans.size(), " ", short_name_of(files));
}

}  // namespace revisit::pipeline
