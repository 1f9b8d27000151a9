#include "revisit/recognition/optional_library.h"

#include "testing.h"

namespace revisit {
namespace {

TEST(OptionalLibrary, NamesThePackageAndTheOption) {
  std::set<std::string_view> names;
  for (const OptionalLibrary& library : optional_libraries()) {
    names.insert(library.name);
    const auto rejection = [&] { built_without("this", library.name); };
    expect_error<UsageError>(
        rejection, {str("this: this program was built without ", library.name),
                    str("install ", library.package, " "), str("-D", library.option, "=ON")});
  }
  EXPECT_EQ(names, (std::set<std::string_view>{"FAISS", "OpenCV", "PCL", "libpq"}))
      << "the names that built_without() is called with";
}

}  // namespace
}  // namespace revisit
