#include "cli/csv.h"

#include <gtest/gtest.h>

#include <cmath>

#include "cli/table.h"
#include "expect_error.h"
#include "test_data.h"

namespace revisit::cli {
namespace {

class Csv : public testing::Test {
 protected:
  CsvFile read(const std::string& content) const {
    test::write_file(dir_ / "t.csv", content);
    return CsvFile(dir_ / "t.csv");
  }
  const test::TempDir dir_;
};

TEST_F(Csv, ReadsWhatTableWrites) {
  Table table({"name", "value"});
  table.row({"plain", "1.5"});
  table.row({"a \"quoted\", one\nof two lines", ""});
  std::ostringstream text;
  table.print_csv(text);
  const CsvFile csv = read(text.str());
  ASSERT_EQ(csv.rows(), 2U);
  EXPECT_EQ(csv.text(1, csv.column("name")), "a \"quoted\", one\nof two lines");
  EXPECT_EQ(csv.number(0, csv.column("value")), 1.5);
  EXPECT_TRUE(std::isnan(csv.number(1, csv.column("value"))));
}

TEST_F(Csv, DamageIsNamedByLine) {
  const auto message = [&](const std::string& content) {
    try {
      const CsvFile csv = read(content);
      for (size_t row = 0; row < csv.rows(); ++row) csv.number(row, csv.column("b"));
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  EXPECT_NE(message("a,b\n1,2\n1\n").find("t.csv:3: expected 2 columns"), std::string::npos);
  EXPECT_NE(message("a,b\n1,x\n").find("t.csv:2: column 'b'"), std::string::npos);
  EXPECT_NE(message("a,b\n\"1,2\n").find("t.csv:2: a quote"), std::string::npos);
  EXPECT_NE(message("a,c\n1,2\n").find("no column 'b'"), std::string::npos);
  EXPECT_NE(message("").find("empty file"), std::string::npos);
  EXPECT_THROW(CsvFile(dir_ / "absent.csv"), InputError);
  const CsvFile numbers = read("a\n7\n7.5\n\"\"\n");
  EXPECT_EQ(numbers.whole_number(0, 0), 7);
  EXPECT_THROW(numbers.whole_number(1, 0), InputError);
  EXPECT_THROW(numbers.whole_number(2, 0), InputError) << "a blank is no frame";
}

}  // namespace
}  // namespace revisit::cli
