#include "revisit/base/folder.h"

#include "revisit/base/error.h"

namespace revisit {

void make_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw Error(folder.string(), ": cannot create the folder: ", error.message());
}

}  // namespace revisit
