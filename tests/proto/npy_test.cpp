#include "revisit/proto/npy.h"

#include "damage.h"
#include "testing.h"

namespace revisit::proto {
namespace {

std::string npy(const std::string& dictionary, const std::string& data, char version = 1) {
  const auto length = static_cast<uint32_t>(dictionary.size());
  std::string file = std::string("\x93NUMPY") + version + '\0';
  for (int i = 0; i < (version == 1 ? 2 : 4); ++i)
    file += static_cast<char>(length >> (8 * i) & 0xff);
  return file + dictionary + data;
}
template <class Number>
std::string raw(const std::vector<Number>& values) {
  std::string bytes(values.size() * sizeof(Number), '\0');
  std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}
Blob read(const std::string& content) {
  const TempDir dir;
  write_file(dir / "a.npy", content);
  return read_npy(dir / "a.npy");
}
void expect_rejection(const std::string& content, const std::string& part) {
  const std::string message = message_of<InputError>([&] { read(content); });
  EXPECT_HAS(message, "a.npy: ");
  EXPECT_HAS(message, part);
}
std::string dictionary(const std::string& dtype, const std::string& order,
                       const std::string& shape) {
  return "{'descr': '" + dtype + "', 'fortran_order': " + order + ", 'shape': " + shape + ", }\n";
}

TEST(Npy, RoundTrip) {
  const TempDir dir;
  for (const std::vector<int64_t>& shape : {std::vector<int64_t>{},
                                            {6},
                                            {2, 3},
                                            {1, 3, 107, 4000},
                                            {0},
                                            {4, 0, 2},
                                            std::vector<int64_t>(64, 1)}) {
    size_t count = 1;
    for (const int64_t dim : shape) count *= static_cast<size_t>(dim);
    std::vector<float> data(count);
    for (size_t i = 0; i < count; ++i) data[i] = i == 0 ? INFINITY : 0.1F * static_cast<float>(i);
    write_npy(dir / "a.npy", shape, data.data());
    const Blob back = read_npy(dir / "a.npy");
    EXPECT_EQ(back.shape, shape);
    EXPECT_EQ(back.data, data);
  }
}

TEST(Npy, HeaderIsNumPys) {
  const std::string header = npy_header({2, 3});
  EXPECT_EQ(header.substr(0, 10), std::string("\x93NUMPY\x01\x00\x76\x00", 10));
  EXPECT_EQ(header.substr(10, 59), "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }");
  EXPECT_EQ(header.back(), '\n');
  for (const std::vector<int64_t>& shape :
       {std::vector<int64_t>{}, {7}, {123456789, 4, 5}, {1, 2, 3, 4, 5, 6, 7, 8, 9, 10}}) {
    EXPECT_EQ(npy_header(shape).size() % 64, 0U);
  }
  EXPECT_HAS(npy_header({7}), "'shape': (7,), }");
  EXPECT_HAS(npy_header({}), "'shape': (), }");
}

TEST(Npy, EveryVersionAndFloat64) {
  const std::string data = raw<float>({1, 2});
  for (const char version : {'\1', '\2', '\3'}) {
    EXPECT_EQ(read(npy(dictionary("<f4", "False", "(2,)"), data, version)).data,
              (std::vector<float>{1, 2}));
  }
  EXPECT_EQ(read(npy(dictionary("<f8", "False", "(1, 2)"), raw<double>({0.1, -3}))).data,
            (std::vector<float>{0.1F, -3}));
}

TEST(Npy, HeaderOfOtherWriters) {
  const std::string data = raw<float>({1, 2});
  for (const char* header :
       {"{\"shape\":(2L,),\"fortran_order\":False,\"descr\":\"<f4\"}",
        "  { 'descr' : '<f4' , 'fortran_order' : False , 'shape' : ( 2 , 1 ) }  \n"}) {
    EXPECT_EQ(read(npy(header, data)).data, (std::vector<float>{1, 2}));
  }
}

TEST(Npy, ReasonsForRejection) {
  const std::string data = raw<float>({1, 2});
  for (const char* dtype : {">f4", "<f2", "<i4", "|O", "<c8", "|u1", "f4"}) {
    expect_rejection(npy(dictionary(dtype, "False", "(2,)"), data),
                     std::string("dtype '") + dtype + "', expected");
  }
  expect_rejection(npy(dictionary("<f4", "True", "(2,)"), data), "Fortran order, expected C order");
  expect_rejection(npy("{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (2,), }", data),
                   "dtype is a structure");
  expect_rejection(npy(dictionary("<f4", "False", "(3,)"), data),
                   "shape 3 of '<f4' does not fit the 8 bytes");
  expect_rejection(npy(dictionary("<f4", "False", "(1,)"), data),
                   "shape 1 of '<f4' does not fit the 8 bytes");
  expect_rejection(npy(dictionary("<f4", "False", "(-2,)"), data), "invalid dimension");
  expect_rejection(npy(dictionary("<f4", "False", "(99999999999999999999,)"), data),
                   "invalid dimension");
  expect_rejection(npy(dictionary("<f4", "False", "(4611686018427387904, 8)"), data),
                   "does not fit");
  expect_rejection(npy(dictionary("<f4", "False", "(4611686018427387904,)"), ""), "does not fit");
  expect_rejection(npy("{'descr': '<f4'}", data), "lacks descr, fortran_order or shape");
  expect_rejection(npy("{'descr': '<f4', 'color': 'red'}", data), "unknown header key 'color'");
  expect_rejection(npy("{'descr': '<f4' 'shape': (2,)}", data), "malformed header");
  expect_rejection(npy("", data), "malformed header");
  expect_rejection(npy(dictionary("<f4", "False", "(2,)"), data, 4), ".npy version 4");
  expect_rejection("", "is not a NumPy .npy file");
  expect_rejection("PK\x03\x04 an npz archive", "is not a NumPy .npy file");
  EXPECT_HAS(message_of<InputError>([] { read_npy("/nonexistent/a.npy"); }), "cannot open");
}

TEST(Npy, TruncatedAnywhereIsAnError) {
  const TempDir dir;
  const std::string whole = npy_header({2, 3}) + raw<float>({1, 2, 3, 4, 5, 6});
  write_file(dir / "a.npy", whole);
  for (size_t length = whole.size(); length-- > 0;) {
    SCOPED_TRACE(length);
    std::filesystem::resize_file(dir / "a.npy", length);
    message_of<InputError>([&] { read_npy(dir / "a.npy"); });
  }
}

TEST(Npy, DamagedHeaderIsAnErrorOrStillFitsTheData) {
  const TempDir dir;
  const std::string header = npy_header({2, 3});
  write_file(dir / "a.npy", header + raw<float>({1, 2, 3, 4, 5, 6}));
  int n_errors = 0;
  for (size_t at = 0; at < header.size(); ++at) {
    for (int value = 0; value < 256; ++value) {
      test::patch_file(dir / "a.npy", at, static_cast<char>(value));
      try {
        EXPECT_EQ(read_npy(dir / "a.npy").data.size(), 6U);
      } catch (const InputError&) {
        ++n_errors;
      }
    }
    test::patch_file(dir / "a.npy", at, header[at]);
  }
  EXPECT_GT(n_errors, 10'000);
}

TEST(Npy, RefusesAShapeThatNoFileCanHave) {
  const TempDir dir;
  const std::vector<int64_t> shapes[] = {{int64_t{1} << 62}, {1 << 20, 1 << 20, 1 << 24}, {2, -3}};
  for (const auto& shape : shapes)
    test::expect_error<UsageError>([&] { write_npy(dir / "a.npy", shape, nullptr); },
                                   {"a.npy", "cannot hold an array of shape"});
  EXPECT_FALSE(std::filesystem::exists(dir / "a.npy"));
}

TEST(Npy, ReadsNumPysOwnFiles) {
  REVISIT_NEED_SHARED(file, "golden/inputs/in_1x3x64x160.npy");
  const Blob array = read_npy(file);
  EXPECT_EQ(array.shape, (std::vector<int64_t>{1, 3, 64, 160}));
  EXPECT_EQ(array.data.size(), 3U * 64 * 160);
}

}  // namespace
}  // namespace revisit::proto
