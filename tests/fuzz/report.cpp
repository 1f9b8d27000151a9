// Content of each of the files that `revisit report` finds in folders, in turn.
#include <unistd.h>

#include <fstream>

#include "page_case.h"

namespace revisit::fuzz {
namespace {

namespace fs = std::filesystem;

struct Folders {
  fs::path root = fs::temp_directory_path() / ("revisit_fuzz_report_" + std::to_string(::getpid()));
  fs::path file = root / "case";
  Folders() {
    fs::remove_all(root);  // left by a killed process with the same id
    // An experiment has its runs below it.
    for (const char* name : {"run/run.json", "experiment/experiment.json", "experiment/run.json"}) {
      fs::create_directories((root / name).parent_path());
      fs::create_symlink(file, root / name);
    }
  }
  ~Folders() { fs::remove_all(root); }
};

}  // namespace
}  // namespace revisit::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace revisit;
  static const fuzz::Folders folders;
  std::ofstream(folders.file, std::ios::binary) << fuzz::text(data, size);
  for (const char* folder : {"run", "experiment"}) fuzz::make_page(folders.root / folder);
  return 0;
}
