#include <sys/stat.h>

#include "revisit/base/files.h"
#include "revisit/base/text.h"
#include "testing.h"

namespace revisit {
namespace {

TEST(FileContent, IsTheWholeFileOrItsBeginning) {
  const TempDir dir;
  const std::string bytes = std::string(100'000, 'x') + std::string("\0\n\r", 3);
  write_file(dir / "f", bytes);
  write_file(dir / "empty", "");
  EXPECT_EQ(read_content(dir / "f"), bytes);
  EXPECT_EQ(read_content(dir / "empty"), "");
  EXPECT_EQ(read_head(dir / "f", 3), "xxx");
  EXPECT_EQ(read_head(dir / "f", 1'000'000), bytes);
  EXPECT_EQ(content_if_any(dir / "f"), bytes);
}

TEST(FileContent, RejectsFifosAndFoldersWithoutWaiting) {
  const TempDir dir;
  ASSERT_EQ(::mkfifo((dir / "fifo").c_str(), 0600), 0);
  const std::pair<std::filesystem::path, const char*> cases[] = {
      {dir / "fifo", "is not a regular file"},
      {dir.path(), "is a folder"},
      {dir / "none", "cannot open: No such file"}};
  for (const auto& [file, reason] : cases) {
    expect_error<InputError>([&] { read_content(file); }, {file.string(), reason});
    EXPECT_EQ(content_if_any(file), "");
  }
}

TEST(Joined, HasSeparatorsBetweenTheElements) {
  EXPECT_EQ(joined(std::vector<int>{}, ", "), "");
  EXPECT_EQ(joined(std::vector<double>{1.5}, ", "), "1.5");
  EXPECT_EQ(joined(std::vector<int>{1, 2, 3}, ", ", [](int i) { return 2 * i; }), "2, 4, 6");
  EXPECT_EQ(shape_text({}), "()");
  EXPECT_EQ(shape_text(std::vector<int64_t>{1, 3, 227}), "1x3x227");
}

TEST(NumberType, ReadsEveryTypeInBothByteOrders) {
  const auto read = [](char kind, const std::string& bytes, bool big_endian) {
    return number_reader({kind, bytes.size(), big_endian})(bytes.data());
  };
  EXPECT_EQ(read('i', "\xfe", false), -2.0F);
  EXPECT_EQ(read('u', "\xfe", false), 254.0F);
  EXPECT_EQ(read('i', "\xfe\xff", false), -2.0F);
  EXPECT_EQ(read('u', std::string("\x01\x00", 2), true), 256.0F);
  EXPECT_EQ(read('u', std::string("\x00\x00\x01\x02", 4), true), 258.0F);
  EXPECT_EQ(read('i', "\xff\xff\xff\xff\xff\xff\xff\xfd", true), -3.0F);
  EXPECT_EQ(read('f', std::string("\x00\x00\xc0\x3f", 4), false), 1.5F);
  EXPECT_EQ(read('f', std::string("\x3f\xf8\x00\x00\x00\x00\x00\x00", 8), true), 1.5F);
  EXPECT_EQ(number_reader({'f', 2}), nullptr);
  EXPECT_EQ(number_reader({'i', 3}), nullptr);
  EXPECT_EQ(number_reader({}), nullptr);
}

}  // namespace
}  // namespace revisit
