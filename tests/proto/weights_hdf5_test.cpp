#include "revisit/base/files.h"
#include "revisit/proto/weights_file.h"
#include "testing.h"

#ifdef REVISIT_HAVE_HDF5
#include <hdf5.h>
#endif

namespace revisit::proto {
namespace {

using Blobs = std::map<std::string, std::vector<Blob>>;

Blobs read_all(const fs::path& path, const Limits& limits = {}) {
  const auto file = WeightsFile::open(path, limits);
  Blobs blobs;
  for (size_t i = 0; i < file->layers().size(); ++i) {
    EXPECT_TRUE(blobs.emplace(file->layers()[i].name, file->read(i)).second);
    EXPECT_EQ(blobs[file->layers()[i].name].size(), file->layers()[i].n_blobs);
  }
  return blobs;
}

class WeightsHdf5 : public testing::Test {
 protected:
  void expect_read_error(const std::initializer_list<std::string>& parts,
                         const Limits& limits = {}) const {
    expect_error<InputError>([&] { read_all(path_, limits); }, parts);
  }
  const TempDir dir_;
  const fs::path path_ = dir_ / "w.h5";
};

TEST(WeightsHdf5Golden, SameAsTheCaffemodel) {
  const std::filesystem::path folder = test::golden("formats");
  const Blobs truth = read_all(folder / "mini_v2.caffemodel");
  const Blobs found = read_all(folder / "mini.caffemodel.h5");
  size_t with_blobs = 0;
  for (const auto& [name, blobs] : found) {
    ASSERT_TRUE(truth.contains(name)) << name;
    const std::vector<Blob>& wanted = truth.at(name);
    ASSERT_EQ(blobs.size(), wanted.size()) << name;
    with_blobs += !blobs.empty();
    for (size_t i = 0; i < blobs.size(); ++i) {
      EXPECT_EQ(blobs[i].shape, wanted[i].shape) << name;
      EXPECT_EQ(blobs[i].data, wanted[i].data) << name;
      EXPECT_FALSE(blobs[i].legacy_shape || blobs[i].absent);
    }
  }
  EXPECT_EQ(with_blobs, 4U);
}

TEST_F(WeightsHdf5, TruncatedAnywhere) {
  const std::filesystem::path weights = test::golden("formats/mini.caffemodel.h5");
  const std::string whole = read_file(weights);
  for (size_t size = 8; size < whole.size(); size += 97) {
    write_file(path_, whole.substr(0, size));
    EXPECT_THROW(read_all(path_), InputError) << size;
  }
}

/// Errors must name the file.
bool is_error(const std::string& bytes) {
  const fs::path path = "/folder/w.h5";
  try {
    const auto file = WeightsFile::open(FileCursor(bytes, path));
    for (size_t i = 0; i < file->layers().size(); ++i) file->read(i);
    return false;
  } catch (const Error& error) {
    EXPECT_TRUE(std::string(error.what()).starts_with(path.string() + ": ")) << error.what();
    return true;
  }
}

TEST(WeightsHdf5Damage, OneByteIsAnErrorOrWeights) {
  std::string bytes = read_file(test::golden("formats/mini.caffemodel.h5"));
  int errors = 0;
  for (size_t at = 8; at < bytes.size(); ++at) {
    const char whole = bytes[at];
    for (const char value : {'\0', '\x01', '\x08', '\x7f', '\xff'}) {
      bytes[at] = value;
      errors += is_error(bytes);
    }
    bytes[at] = whole;
  }
  EXPECT_GT(errors, 1000);
}

TEST(WeightsHdf5Damage, ManyBytes) {
  const std::string whole = read_file(test::golden("formats/mini.caffemodel.h5"));
  std::mt19937 random(20);
  const auto below = [&](size_t n) { return random() % n; };
  int errors = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    SCOPED_TRACE(trial);
    std::string bytes = whole;
    for (size_t n = 1 + below(12); n > 0; --n) {
      const size_t at = 8 + below(bytes.size() - 16);
      if (below(2) == 0) {
        bytes[at] = static_cast<char>(below(256));
      } else {  // overwrites a field with another address or name
        bytes.replace(at, 8, bytes.substr(below(bytes.size() - 8), 8));
      }
    }
    errors += is_error(bytes);
  }
  EXPECT_GT(errors, 300);
}

#ifdef REVISIT_HAVE_HDF5

/// Does not close ids, because H5Fclose closes them all.
class Writer {
 public:
  explicit Writer(const fs::path& path, bool newest_format = false) {
    const hid_t access = H5Pcreate(H5P_FILE_ACCESS);
    if (newest_format) H5Pset_libver_bounds(access, H5F_LIBVER_LATEST, H5F_LIBVER_LATEST);
    H5Pset_fclose_degree(access, H5F_CLOSE_STRONG);
    file_ = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access);
    H5Pclose(access);
    parents_ = H5Pcreate(H5P_LINK_CREATE);
    H5Pset_create_intermediate_group(parents_, 1);
  }
  ~Writer() {
    H5Pclose(parents_);
    H5Fclose(file_);
  }
  void group(const std::string& path) {
    EXPECT_GE(H5Gcreate2(file_, path.c_str(), parents_, H5P_DEFAULT, H5P_DEFAULT), 0);
  }
  template <class Number>
  void array(const std::string& path, const std::vector<hsize_t>& shape,
             const std::vector<Number>& values, hid_t memory, hid_t stored,
             hid_t layout = H5P_DEFAULT) {
    const hid_t space =
        shape.empty() ? H5Screate(H5S_SCALAR)
                      : H5Screate_simple(static_cast<int>(shape.size()), shape.data(), nullptr);
    const hid_t dataset =
        H5Dcreate2(file_, path.c_str(), stored, space, parents_, layout, H5P_DEFAULT);
    EXPECT_GE(dataset, 0) << path;
    if (!values.empty()) {
      EXPECT_GE(H5Dwrite(dataset, memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0);
    }
  }
  void floats(const std::string& path, const std::vector<hsize_t>& shape,
              const std::vector<float>& values, hid_t layout = H5P_DEFAULT) {
    array(path, shape, values, H5T_NATIVE_FLOAT, H5T_IEEE_F32LE, layout);
  }
  void soft_link(const std::string& target, const std::string& path) {
    EXPECT_GE(H5Lcreate_soft(target.c_str(), file_, path.c_str(), parents_, H5P_DEFAULT), 0);
  }
  hid_t id() const { return file_; }

 private:
  hid_t file_ = -1, parents_ = -1;
};

TEST_F(WeightsHdf5, NamesWithSlashesAndAnyRankAndNumber) {
  {
    Writer out(path_);
    out.floats("/data/fire2/squeeze1x1/0", {2, 1, 1, 1}, {1, 2});
    out.floats("/data/fire2/squeeze1x1/1", {2}, {3, 4});
    out.array<double>("/data/conv1/0", {2, 1}, {0.1, 1e300}, H5T_NATIVE_DOUBLE, H5T_IEEE_F64LE);
    out.array<double>("/data/conv1/1", {1}, {0.5}, H5T_NATIVE_DOUBLE, H5T_IEEE_F64BE);
    out.array<int>("/data/conv1/2", {}, {-7}, H5T_NATIVE_INT, H5T_STD_I16BE);
    out.floats("/data/conv1/bn/0", {1}, {5});  // a layer below a layer
    out.floats("/data/0/0", {1}, {6});         // a layer with the name of a blob
    out.floats("/data/conv1/not_a_blob", {1}, {9});
    out.floats("/data/conv1/007", {1}, {9});
    out.floats("/data/stray", {1}, {9});
    out.group("/data/relu1");
    out.group("/elsewhere/fc/0");
  }
  const Blobs blobs = read_all(path_);
  std::vector<std::string> names;
  for (const auto& [name, unused] : blobs) names.push_back(name);
  EXPECT_EQ(names,
            (std::vector<std::string>{"0", "conv1", "conv1/bn", "fire2/squeeze1x1", "relu1"}));
  EXPECT_EQ(blobs.at("fire2/squeeze1x1")[0].shape, (std::vector<int64_t>{2, 1, 1, 1}));
  EXPECT_EQ(blobs.at("fire2/squeeze1x1")[1].data, (std::vector<float>{3, 4}));
  const std::vector<Blob>& conv = blobs.at("conv1");
  ASSERT_EQ(conv.size(), 3U);
  EXPECT_EQ(conv[0].data, (std::vector<float>{0.1F, INFINITY}));
  EXPECT_EQ(conv[1].data, std::vector<float>{0.5F});
  EXPECT_EQ(conv[2].data, std::vector<float>{-7});
  EXPECT_TRUE(conv[2].shape.empty());
  EXPECT_EQ(blobs.at("conv1/bn")[0].data, std::vector<float>{5});
  EXPECT_EQ(blobs.at("0")[0].data, std::vector<float>{6});
  EXPECT_TRUE(blobs.at("relu1").empty());
}

TEST_F(WeightsHdf5, SharedArrays) {
  {
    Writer out(path_);
    out.floats("/data/a/0", {2}, {1, 2});
    out.soft_link("/data/a/0", "/data/b/0");
    out.soft_link("a", "/data/c");
    out.floats("/data/d/1", {1}, {3});  // its blob 0 is another layer's
    out.soft_link("/data", "/data/loop");
    out.soft_link("./../data/nowhere", "/data/dangling");
    out.soft_link("to_a", "/data/to_to_a");
    out.soft_link("a", "/data/to_a");
  }
  const Blobs blobs = read_all(path_);
  EXPECT_EQ(blobs.at("b")[0].data, (std::vector<float>{1, 2}));
  EXPECT_EQ(blobs.at("c")[0].data, (std::vector<float>{1, 2}));
  EXPECT_EQ(blobs.at("to_to_a")[0].data, (std::vector<float>{1, 2}));
  ASSERT_EQ(blobs.at("d").size(), 2U);
  EXPECT_TRUE(blobs.at("d")[0].absent);
  EXPECT_EQ(blobs.at("d")[1].data, std::vector<float>{3});
}

class Chunks {
 public:
  explicit Chunks(hsize_t size) {
    H5Pset_chunk(id_, 1, &size);
    H5Pset_deflate(id_, 9);
  }
  ~Chunks() { H5Pclose(id_); }
  hid_t id() const { return id_; }

 private:
  hid_t id_ = H5Pcreate(H5P_DATASET_CREATE);
};

TEST_F(WeightsHdf5, FormsThatCaffeDoesNotWriteAreNamed) {
  const auto expect_unsupported = [&](const std::initializer_list<std::string>& parts) {
    expect_error<UnsupportedError>([&] { read_all(path_); }, parts);
  };
  { Writer(path_).floats("/data/c/0", {7}, std::vector<float>(7), Chunks(7).id()); }
  expect_unsupported(
      {"w.h5: layer 'c', blob 0: its values are in chunks or compressed", "save it"});
  { Writer(path_, true).floats("/data/c/0", {7}, std::vector<float>(7)); }
  expect_unsupported({"HDF5 superblock version", "save it", "libver='earliest'"});
  {
    Writer out(path_);
    out.group("/data/c");
    H5Lcreate_external("other", "/data/c/0", out.id(), "/data/c/0", H5P_DEFAULT, H5P_DEFAULT);
  }
  expect_unsupported({"an HDF5 group of a newer format"});
  write_file(dir_ / "raw", "12345678");
  {
    Writer out(path_);
    const hid_t external = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_external(external, (dir_ / "raw").c_str(), 0, 8);
    out.floats("/data/c/0", {2}, {}, external);
    H5Pclose(external);
  }
  expect_unsupported({"layer 'c', blob 0: its values are in another file"});
  { Writer(path_).array<int>("/data/c/0", {1}, {}, H5T_NATIVE_INT, H5T_C_S1); }
  expect_unsupported({"holds no floats, doubles or integers"});
  { Writer(path_).array<float>("/data/c/0", {1}, {1}, H5T_NATIVE_FLOAT, H5T_VAX_F32); }
  expect_unsupported({"holds no floats, doubles or integers"});
}

TEST_F(WeightsHdf5, ReadsOnlyTheArraysAsked) {
  {
    Writer out(path_);
    out.floats("/data/a/0", {10}, std::vector<float>(10));
    out.floats("/data/b/0", {1'000'000}, std::vector<float>(1'000'000));
  }
  const auto file = WeightsFile::open(path_);
  for (size_t i = 0; i < 2; ++i)
    if (file->layers()[i].name == "a") file->read(i);
  EXPECT_LT(file->bytes_read(), 20'000U);
}

TEST_F(WeightsHdf5, CompactArrays) {
  {
    Writer out(path_);
    const hid_t compact = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_layout(compact, H5D_COMPACT);
    out.floats("/data/c/0", {2, 2}, {1, 2, 3, 4}, compact);
    H5Pclose(compact);
    out.floats("/data/c/1", {0, 3}, {});
  }
  const Blobs blobs = read_all(path_);
  EXPECT_EQ(blobs.at("c")[0].data, (std::vector<float>{1, 2, 3, 4}));
  EXPECT_EQ(blobs.at("c")[1].shape, (std::vector<int64_t>{0, 3}));
}

TEST_F(WeightsHdf5, GroupsOfManyLayers) {
  {
    Writer out(path_);
    for (int i = 0; i < 5000; ++i)
      out.floats("/data/layer_" + std::to_string(i) + "/0", {1}, {static_cast<float>(i)});
  }
  const Blobs blobs = read_all(path_);
  ASSERT_EQ(blobs.size(), 5000U);
  for (int i = 0; i < 5000; ++i)
    EXPECT_EQ(blobs.at("layer_" + std::to_string(i))[0].data[0], static_cast<float>(i));
}

TEST_F(WeightsHdf5, SizesAreCheckedBeforeMemoryIsTaken) {
  const auto with = [&](const std::vector<hsize_t>& shape) {
    Writer(path_).floats("/data/c/0", shape, {});
  };
  with({1 << 14, 1 << 14});  // a gigabyte without stored values
  expect_read_error({"layer 'c', blob 0: shape 16384x16384", "no stored values"});
  with({hsize_t{1} << 40});
  expect_read_error({"layer 'c', blob 0", "more than 2147483647 elements"});
  with({hsize_t{1} << 31});
  expect_read_error({"more than 2147483647 elements"});
  with({INT32_MAX});
  expect_read_error({"no stored values"});
}

TEST_F(WeightsHdf5, IgnoresObjectsWithoutWeights) {
  { Writer out(path_); }
  expect_read_error({"without the group /data"});
  { Writer(path_).group("/data"); }
  expect_read_error({"HDF5 file without layers"});
  { Writer(path_).soft_link("/nowhere", "/data/c/0"); }
  expect_read_error({"'/data/c/0' does not lead to an array"});
  { Writer(path_).floats("/data/c/64", {1}, {1}); }
  expect_read_error({"layer 'c' has blob 64"});
  {
    Writer out(path_);
    std::string deep = "/data";
    for (int i = 0; i < 17; ++i) deep += "/x";
    out.group(deep);
  }
  expect_read_error({"nested too deeply"});
  {
    Writer out(path_);
    for (int i = 0; i < 3; ++i) out.group("/data/" + std::to_string(i));
  }
  expect_read_error({"more than 2 layers", "limit of layers"}, {.layers = 2});
  {
    Writer out(path_);
    for (int i = 0; i < 20; ++i) out.floats("/data/c/" + std::to_string(i), {1}, {1});
  }
  expect_read_error({"too many links", "limit of layers"}, {.layers = 1});
  expect_read_error({"MB (raise the limit of weights)"}, {.weight_bytes = 100});
}

TEST_F(WeightsHdf5, CirclesEnd) {
  {
    Writer out(path_);
    out.floats("/data/a/0", {1}, {1});
    const auto link = [&](const char* target, const char* path) {
      H5Lcreate_hard(out.id(), target, out.id(), path, H5P_DEFAULT, H5P_DEFAULT);
    };
    link("/data", "/data/a/up");
    link("/data/a", "/data/a/same");
    link("/", "/data/root");
  }
  const Blobs blobs = read_all(path_);
  EXPECT_EQ(blobs.at("a")[0].data, std::vector<float>{1});
  EXPECT_EQ(blobs.at("a/same")[0].data, std::vector<float>{1});
}

#endif

}  // namespace
}  // namespace revisit::proto
