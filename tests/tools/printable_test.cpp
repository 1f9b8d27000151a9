#include "cli/terminal.h"
#include "revisit/proto/npy.h"
#include "testing.h"

namespace revisit::cli {
namespace {

TEST(Printable, EscapesControlCharacters) {
  EXPECT_EQ(printable("conv1/relu {ä€😀}"), "conv1/relu {ä€😀}");
  EXPECT_EQ(printable("\x1b]0;pwn\a\x1b[31m"), "\\x1b]0;pwn\\x07\\x1b[31m");
  EXPECT_EQ(printable(std::string("a\0b\n\t\r\x7f", 7)), "a\\x00b\\x0a\\x09\\x0d\\x7f");
  EXPECT_EQ(printable("\u009b31m"), "\\xc2\\x9b31m") << "the escape of terminals with 8 bits";
  EXPECT_EQ(printable("\x9b \xe2\x82 \xff \xc0\x9b"), "\\x9b \\xe2\\x82 \\xff \\xc0\\x9b");
}

TEST(Printable, ReplacesInvalidUtf8) {
  EXPECT_EQ(utf8("ä€😀\x1b\n"), "ä€😀\x1b\n");
  EXPECT_EQ(utf8("Stra\xdf"
                 "e"),
            "Stra\uFFFDe");
  EXPECT_EQ(utf8("\xe2\x82"), "\uFFFD\uFFFD") << "cut off";
  EXPECT_EQ(utf8("\xc0\x9b"), "\uFFFD\uFFFD") << "longer than need be";
  EXPECT_EQ(utf8("\xe0\x80\x80 \xed\xa0\x80"), "\uFFFD\uFFFD\uFFFD \uFFFD\uFFFD\uFFFD");
  EXPECT_EQ(utf8("\xf0\x80\x80\x80 \xf4\x90\x80\x80").find_first_not_of("\uFFFD "),
            std::string::npos);
}

TEST(Number, HasNoNegativeZero) {
  EXPECT_EQ(number(-0.001, 2), "0.00");
  EXPECT_EQ(number(-0.0, 0), "0");
  EXPECT_EQ(number(-0.005001, 2), "-0.01");
  EXPECT_EQ(number(-INFINITY, 2), "-inf");
  EXPECT_EQ(number(NAN, 2), "");
}

TEST(Printable, StreamsKeepLinesAndCharactersThatComeInPieces) {
  std::ostringstream out;
  {
    const PrintableStream safe(out);
    for (const char c : std::string("ä€😀\x1b[0m\n\tz")) out << c;
    out << "\xe2\x82"
        << "|" << std::flush << "\xe2";
  }
  out << "\x1b";
  EXPECT_EQ(out.str(), "ä€😀\\x1b[0m\n\tz\\xe2\\x82|\\xe2\x1b");
}

TEST(Table, CellsAreMadePrintableAndCsvIsExact) {
  Table table({"layer", "n"});
  table.row({"\x1b[31m,\r", "1"});
  table.row({"a \"b\"", ""});
  std::ostringstream text, csv;
  table.print(text);
  table.print_csv(csv);
  EXPECT_EQ(text.str(), "layer          n\n\\x1b[31m,\\x0d  1\na \"b\"\n");
  EXPECT_EQ(csv.str(), "layer,n\n\"\x1b[31m,\r\",1\n\"a \"\"b\"\"\",\n");
}

TEST(Table, TimeGrowsAsTheRowsDo) {
  Table table({"a", "b", "c", "d"});
  for (int i = 0; i < 30'000; ++i) table.row({"layer", "1", "2.5", "x"});
  std::ostringstream out;
  const std::clock_t start = std::clock();  // processor time, because other processes may run
  table.print(out);
  EXPECT_LT((std::clock() - start) / CLOCKS_PER_SEC, 5) << "by hand: 0.02 s; quadratic: minutes";
}

TEST(TerminalEscapes, OfAPrototxtReachNeitherTheTerminalNorFileNames) {
  const TempDir dir;
  const std::string file = (dir / "n.prototxt").string();
  write_file(file,
             R"(name: "\033]0;pwn\007" layer { name: "in" type: "Input" top: "in\033[2J"
           input_param { shape { dim: 1 dim: 2 } } }
         layer { name: "y\033[2J" type: "ReLU" bottom: "in\033[2J" top: "y\033[2J" }
         layer { name: "z\000cut" type: "ReLU" bottom: "y\033[2J" top: "z\000cut" })");
  proto::write_npy(dir / "in.npy", {1, 2}, std::vector<float>{-1, 1}.data());
  const auto inspect = test::run_revisit("net inspect " + file);
  const auto forward =
      test::run_revisit("net forward " + file + " --all -i " + (dir / "in.npy").string() + " -o " +
                        (dir / "out").string());
  const auto unknown = test::run_revisit("net inspect " + file + " --end zz");
  for (const auto& result : {inspect, forward, unknown})
    EXPECT_EQ((result.out + result.err).find_first_of("\033\007"), std::string::npos);
  EXPECT_HAS(inspect.out, "net \\x1b]0;pwn\\x07");
  EXPECT_HAS(inspect.out, "y\\x1b[2J");
  EXPECT_EQ(forward.exit_code, 0) << forward.err;
  EXPECT_TRUE(std::filesystem::exists(dir / "out/out_y\\x1b[2J.npy"));
  EXPECT_TRUE(std::filesystem::exists(dir / "out/out_z\\x00cut.npy"));

  const auto csv = test::run_revisit("net inspect " + file + " --format csv");
  EXPECT_HAS(csv.out, "\ny\033[2J,ReLU") << "CSV is exact";
  write_file(file, R"(layer { name: "a" type: "Bad\033[31m" top: "a" })");
  const auto bad = test::run_revisit("net inspect " + file);
  EXPECT_HAS(bad.err, "Bad\\x1b[31m");
  const auto path = test::run_revisit("net inspect '/no\033[31m'");
  EXPECT_HAS(path.err, "/no\\x1b[31m");
}

}  // namespace
}  // namespace revisit::cli
