#include <sys/stat.h>

#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/datasets/describe.h"

namespace revisit::pipeline {

namespace fs = std::filesystem;

std::string dataset_key(const Dataset& dataset) {
  std::string files;
  for (const ScanRef& scan : dataset.scans) {
    struct stat s {};  // all zero for a file that is not there: its reader says so
    if (::stat(scan.file.c_str(), &s) != 0) s = {};
    files +=
        str(fs::absolute(scan.file).string(), " ", s.st_size, " ", s.st_mtim.tv_sec, ".",
            s.st_mtim.tv_nsec, " ", s.st_ino, " ", s.st_ctim.tv_sec, ".", s.st_ctim.tv_nsec, "\n");
  }
  return str("scans ", dataset.scans.size(), " ", short_name_of(files));
}

}  // namespace revisit::pipeline
