#include "revisit/proto/weights_file.h"

#include <sys/stat.h>

#include <bit>

#include "caffe_schema.pb.h"
#include "damage.h"
#include "revisit/proto/npy.h"
#include "testing.h"
#include "wire_bytes.h"

namespace revisit::proto {
namespace {

bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), [](float x, float y) {
           return std::bit_cast<uint32_t>(x) == std::bit_cast<uint32_t>(y) ||
                  (std::isnan(x) && std::isnan(y));
         });
}
bool same_blob(const Blob& a, const Blob& b) {
  return a.shape == b.shape && a.legacy_shape == b.legacy_shape && same_bits(a.data, b.data);
}

Blob decode(const std::string& blob) {
  const TempDir dir;
  write_file(dir / "w", model_of({blob}));
  return WeightsFile::open(dir / "w")->read(0).at(0);
}
std::string decode_error(const std::string& blob) {
  return message_of<InputError>([&] { decode(blob); });
}
std::string open_error(const std::string& content) {
  const TempDir dir;
  write_file(dir / "w", content);
  std::string message = message_of<InputError>([&] { WeightsFile::open(dir / "w"); });
  const std::string path = (dir / "w").string() + ": ";
  EXPECT_TRUE(message.starts_with(path)) << message;
  return message.substr(std::min(path.size(), message.size()));
}
bool contains(const std::string& text, const std::string& part) {
  const bool found = text.find(part) != std::string::npos;
  if (!found) ADD_FAILURE() << "'" << part << "' is not in: " << text;
  return found;
}

TEST(BlobEncoding, PackedUnpackedAndChunkedDataAreTheSame) {
  const std::vector<float> values = {1, -2.5F, 0, 1e-40F, INFINITY, 7};
  for (const std::string& data :
       {packed_data(values), unpacked_data(values),
        packed_data({1, -2.5F}) + packed_data({}) + packed_data({0, 1e-40F, INFINITY, 7}),
        unpacked_data({1}) + packed_data({-2.5F, 0, 1e-40F}) + unpacked_data({INFINITY, 7})}) {
    for (const std::string& blob : {shape({2, 3}) + data, data + shape({2, 3})}) {
      const Blob decoded = decode(blob);
      EXPECT_EQ(decoded.shape, (std::vector<int64_t>{2, 3}));
      EXPECT_FALSE(decoded.legacy_shape);
      EXPECT_TRUE(same_bits(decoded.data, values));
    }
  }
}

TEST(BlobEncoding, ShapeUnpackedAndInPieces) {
  const std::string unpacked = bytes_field(7, varint_field(1, 2) + varint_field(1, 1));
  EXPECT_EQ(decode(unpacked + packed_data({1, 2})).shape, (std::vector<int64_t>{2, 1}));
  EXPECT_EQ(decode(shape({1}) + packed_data({1, 2}) + shape({2})).shape,
            (std::vector<int64_t>{1, 2}));
  EXPECT_EQ(decode(shape({}) + packed_data({5})).shape, std::vector<int64_t>{});
  EXPECT_EQ(decode(shape({3, 0})).data.size(), 0U);
}

TEST(BlobEncoding, LegacyDimensionsWinOverShape) {
  const std::string legacy =
      varint_field(1, 1) + varint_field(2, 2) + varint_field(3, 1) + varint_field(4, 3);
  const Blob blob = decode(shape({6}) + legacy + packed_data({1, 2, 3, 4, 5, 6}));
  EXPECT_TRUE(blob.legacy_shape);
  EXPECT_EQ(blob.shape, (std::vector<int64_t>{1, 2, 1, 3}));
  // Any one of the four is enough; those that are absent are 0.
  EXPECT_EQ(decode(varint_field(4, 3) + shape({2})).shape, (std::vector<int64_t>{0, 0, 0, 3}));
  // The last value of a repeated scalar counts.
  EXPECT_EQ(decode(varint_field(1, 5) + varint_field(1, 0)).shape,
            (std::vector<int64_t>{0, 0, 0, 0}));
}

TEST(BlobEncoding, DoubleDataIsPreferred) {
  const std::string packed = bytes_field(8, raw<double>({0.5, 1e-3}));
  const std::string unpacked = tag(8, 1) + raw<double>({0.5}) + tag(8, 1) + raw<double>({1e-3});
  for (const std::string& doubles : {packed, unpacked}) {
    EXPECT_EQ(decode(shape({2}) + packed_data({8, 9, 10}) + doubles).data,
              (std::vector<float>{0.5F, 1e-3F}));
  }
  std::vector<double> many(10'000);
  for (size_t i = 0; i < many.size(); ++i) many[i] = static_cast<double>(i);
  const Blob blob = decode(shape({many.size()}) + bytes_field(8, raw(many)));
  EXPECT_TRUE(std::equal(many.begin(), many.end(), blob.data.begin(), blob.data.end()));
}

/// Encodings of NVIDIA's fork and OpenCV's shrinkCaffeModel().
TEST(BlobEncoding, RawDataOfFloat16FloatOrDouble) {
  const std::vector<uint16_t> halves{0x3C00, 0xC100, 0x7BFF, 0x0400,
                                     0x8001, 0x8000, 0x7C00, 0x7E00};
  const std::vector<float> values{1, -2.5F, 65504, 0x1p-14F, -0x1p-24F, -0.0F, INFINITY, NAN};
  const auto type = [](uint64_t number) { return varint_field(10, number); };
  EXPECT_TRUE(same_bits(decode(shape({8}) + type(2) + bytes_field(12, raw(halves))).data, values));
  EXPECT_TRUE(
      same_bits(decode(bytes_field(12, raw(halves)) + type(2) + shape({2, 4})).data, values));
  EXPECT_TRUE(same_bits(decode(shape({8}) + type(1) + bytes_field(12, raw(values))).data, values));
  EXPECT_EQ(decode(shape({2}) + bytes_field(12, raw<double>({0.5, 1e-3}))).data,
            (std::vector<float>{0.5F, 1e-3F}));
  EXPECT_EQ(decode(shape({1}) + packed_data({4}) + type(2) + bytes_field(12, raw(halves))).data,
            std::vector<float>{4});
  contains(decode_error(shape({1}) + type(3) + bytes_field(12, "abcd")), "raw_data_type 3");
  contains(decode_error(shape({1}) + type(2) + bytes_field(12, "abc")), "2-byte values");
  contains(decode_error(shape({3}) + type(2) + bytes_field(12, "abcd")), "3 values, found 2");
}

TEST(BlobEncoding, DiffsAndUnknownFieldsAreSkipped) {
  const std::string group = tag(20, 3) + tag(21, 3) + varint_field(1, 9) + tag(5, 5) +
                            raw<float>({9}) + tag(21, 4) + tag(20, 4);
  const std::string noise = bytes_field(6, raw<float>({9, 9})) + bytes_field(9, raw<double>({9})) +
                            varint_field(500, 7) + tag(501, 1) + raw<double>({9}) +
                            bytes_field(502, "x") + group + varint_field(5, 3) +
                            bytes_field(1, "x") + tag(7, 5) + raw<float>({9});  // wrong wire types
  EXPECT_EQ(decode(noise + shape({1}) + noise + packed_data({4}) + noise).data,
            std::vector<float>{4});
}

TEST(BlobEncoding, CorruptBlobsAreErrorsWithOffsetLayerAndBlob) {
  const std::string message = decode_error(shape({2, 3}) + packed_data({1, 2}));
  contains(message, "/w: byte 26: layer 'c', blob 0: shape 2x3 needs 6 values, found 2");
  contains(decode_error(""), "shape () (none given) needs 1 values, found 0");
  contains(decode_error(shape({uint64_t(-1)}) + packed_data({1})),
           "negative dimension in shape -1");
  contains(decode_error(varint_field(2, uint64_t(-4))), "negative dimension in shape 0x-4x0x0");
  contains(decode_error(shape({1U << 16, 1U << 15})), "has more than 2147483647 elements");
  contains(decode_error(shape({uint64_t{1} << 62, 4})), "has more than 2147483647 elements");
  contains(decode_error(shape(std::vector<uint64_t>(33, 1)) + packed_data({1})),
           "more than 32 axes");
  contains(decode_error(bytes_field(5, "abc")),
           "packed field of 3 bytes is not a multiple of 4-byte values");
  contains(decode_error(tag(5, 2) + varint(1000) + "abcd"),
           "field 5 needs 1000 bytes, only 4 are left");
  contains(decode_error(tag(5, 2) + varint(std::numeric_limits<uint64_t>::max())),
           "only 0 are left");
  contains(decode_error(bytes_field(7, tag(1, 2) + "\x01\x80")), "a dimension is truncated");
  contains(decode_error(tag(5, 6)), "illegal field tag");
  contains(decode_error(tag(0, 0) + "\x01"), "illegal field tag");
  contains(decode_error(tag(9, 4)), "end of a group without its start");
  contains(decode_error(tag(9, 3)), "a field tag is truncated");
  contains(decode_error(tag(9, 3) + tag(10, 4)), "group 9 is closed as 10");
  std::string deep;
  for (int i = 0; i < 1000; ++i) deep += tag(9, 3);
  contains(decode_error(deep), "nested too deeply");
  contains(decode_error(tag(1, 0) + std::string(11, '\xff')), "longer than 10 bytes");
}

TEST(WeightsFile, EveryGenerationOfLayers) {
  const std::string blob = shape({1}) + packed_data({3});
  const std::string v0 =
      bytes_field(50, blob) + bytes_field(2, "innerproduct") + bytes_field(1, "f");
  const std::string v1 =
      varint_field(5, 4) + bytes_field(6, blob) + bytes_field(4, "c") + bytes_field(6, blob);
  const TempDir dir;
  write_file(dir / "w", bytes_field(2, bytes_field(2, "bottom") + bytes_field(1, v0)) +
                            bytes_field(2, v1) + bytes_field(2, varint_field(5, 999)) +
                            bytes_field(2, bytes_field(1, bytes_field(2, "padding"))));
  const auto file = WeightsFile::open(dir / "w");
  ASSERT_EQ(file->layers().size(), 4U);
  EXPECT_EQ(file->layers()[0].name, "f");
  EXPECT_EQ(file->layers()[0].n_blobs, 1U);
  EXPECT_EQ(file->layers()[1].name, "c");
  EXPECT_EQ(file->layers()[1].n_blobs, 2U);
  EXPECT_EQ(file->read(0).at(0).data, std::vector<float>{3});
  EXPECT_EQ(file->read(1).at(1).data, std::vector<float>{3});
  EXPECT_TRUE(file->read(2).empty());
}

TEST(WeightsFile, ReadsRequestedLayersOnly) {
  caffe::NetParameter net;
  constexpr int kLayers = 10, kValues = 1 << 18;  // 1 MB a blob
  for (int i = 0; i < kLayers; ++i) {
    caffe::LayerParameter& layer = *net.add_layer();
    layer.set_name("layer" + std::to_string(i));
    caffe::BlobProto& blob = *layer.add_blobs();
    blob.mutable_shape()->add_dim(kValues);
    for (int k = 0; k < kValues; ++k) blob.add_data(static_cast<float>(i));
    for (int k = 0; k < kValues; ++k) blob.add_diff(1);
  }
  const TempDir dir;
  write_file(dir / "w", net.SerializeAsString());
  const auto file = WeightsFile::open(dir / "w");
  EXPECT_LT(file->bytes_read(), 20'000U);
  const uint64_t before = file->bytes_read();
  EXPECT_EQ(file->read(7).at(0).data, std::vector<float>(kValues, 7.F));
  EXPECT_LT(file->bytes_read() - before, kValues * sizeof(float) + 10'000);
}

TEST(BlobEncoding, VolumesOfC3dHaveNumbersOfTheirOwn) {
  std::string sizes;
  for (const uint32_t number : {1, 2, 3, 4, 5}) sizes += varint_field(number, number == 3 ? 3 : 1);
  const std::string data = bytes_field(6, raw<float>({1, 2, 3}));
  const Blob blob = decode(sizes + data);
  EXPECT_EQ(blob.shape, (std::vector<int64_t>{1, 1, 3, 1, 1}));
  EXPECT_EQ(blob.data, (std::vector<float>{1, 2, 3}));
  EXPECT_TRUE(blob.legacy_shape);
}

TEST(WeightsFile, ThingsThatAreNoCaffemodel) {
  EXPECT_EQ(open_error(""), "is empty, expected a caffemodel");
  EXPECT_EQ(open_error(bytes_field(1, "a net")), "holds no layers, expected a caffemodel");
  const std::string lfs = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\n";
  for (const std::string& text :
       {std::string("name: \"AlexNet\"\nlayer { name: \"data\" }\n"), std::string("i 12345678")})
    contains(open_error(text), "is text, expected a binary caffemodel");
  contains(open_error("\n<!DOCTYPE html>\r\n<html>\t</html>"), "is a web page; download");
  contains(open_error(lfs), "is a Git LFS pointer; fetch the file itself: git lfs pull");
  const TempDir other;
  write_file(other / "m", lfs);
  contains(message_of<InputError>([&] { read_binaryproto(other / "m"); }), "a Git LFS pointer");
  contains(open_error(bytes_field(100, "") + bytes_field(2, "")),
           "both V1 `layers` and V2 `layer`");
  contains(open_error(bytes_field(100, bytes_field(1, std::string(100'000, 'x')))),
           "a layer name of 100000 bytes");
  std::string many;
  for (int i = 0; i < 20'001; ++i) many += bytes_field(100, "");
  contains(open_error(many), "more than 20000 layers (raise the limit of layers");

  const TempDir dir;
  contains(message_of<InputError>([&] { WeightsFile::open(dir / "none"); }),
           "none: cannot open: No such file");
  contains(message_of<InputError>([&] { WeightsFile::open(dir.path()); }),
           ": is a folder, expected a file");
  ASSERT_EQ(::mkfifo((dir / "pipe").c_str(), 0600), 0);
  contains(message_of<InputError>([&] { WeightsFile::open(dir / "pipe"); }),
           "pipe: is not a regular file");
}

TEST(WeightsFile, LimitsAreNamedWithTheOptionThatRaisesThem) {
  const TempDir dir;
  write_file(dir / "w", model_of({shape({3}) + packed_data({1, 2, 3})}) + bytes_field(100, ""));
  const auto error = [&](const Limits& limits) {
    return message_of<InputError>([&] { WeightsFile::open(dir / "w", limits)->read(0); });
  };
  contains(error({.weight_bytes = 10}), "more than the limit of 0 MB (raise the limit of weights)");
  contains(error({.layers = 1}), "more than 1 layers (raise the limit of layers)");
  EXPECT_EQ(WeightsFile::open(dir / "w", {.layers = 2})->read(0).size(), 1U);
}

TEST(WeightsFile, AnArrayHasAtMostCaffesNumberOfElements) {
  const TempDir dir;
  const auto error = [&](uint64_t elements) {
    write_file(dir / "w", model_of({shape({elements}) + packed_data({1, 2, 3})}));
    return message_of<InputError>([&] { WeightsFile::open(dir / "w")->read(0); });
  };
  contains(error(uint64_t{1} << 31), "shape 2147483648 has more than 2147483647 elements");
  contains(error(INT32_MAX), "shape 2147483647 needs 2147483647 values, found 3");
}

TEST(WeightsFile, LargerThanProtobufAllows) {
  const TempDir dir;
  write_file(dir / "w", model_of({}));
  fs::resize_file(dir / "w", uint64_t{1} << 31);  // sparse
  contains(message_of<InputError>([&] { WeightsFile::open(dir / "w"); }),
           "is 2147483648 bytes; a caffemodel has at most 2147483647");
}

TEST(WeightsFile, FileThatShrinksWhileOpen) {
  const TempDir dir;
  write_file(dir / "w", model_of({shape({100'000}) + packed_data(std::vector<float>(100'000))}));
  const auto file = WeightsFile::open(dir / "w");
  fs::resize_file(dir / "w", 1000);
  contains(message_of<InputError>([&] { file->read(0); }), "the file became shorter");
}

struct TwinLayer {
  std::string name;
  std::vector<std::optional<Blob>> blobs;  // nullopt: inconsistent
};

std::optional<Blob> twin_blob(const caffe::BlobProto& proto) {
  Blob blob;
  blob.legacy_shape =
      proto.has_num() || proto.has_channels() || proto.has_height() || proto.has_width();
  if (blob.legacy_shape) {
    blob.shape = {proto.num(), proto.channels(), proto.height(), proto.width()};
  } else {
    blob.shape.assign(proto.shape().dim().begin(), proto.shape().dim().end());
  }
  blob.data.assign(proto.data().begin(), proto.data().end());
  if (proto.double_data_size() > 0) {
    blob.data.clear();
    for (const double value : proto.double_data()) blob.data.push_back(static_cast<float>(value));
  }
  if (blob.data.empty() && proto.has_raw_data()) {  // a corrupt byte yields doubles at most
    const std::string& bytes = proto.raw_data();
    if (proto.raw_data_type() != 0 || bytes.size() % sizeof(double) != 0) return std::nullopt;
    std::vector<double> values(bytes.size() / sizeof(double));
    std::memcpy(values.data(), bytes.data(), bytes.size());
    for (const double value : values) blob.data.push_back(static_cast<float>(value));
  }
  long double count = 1;
  for (const int64_t dim : blob.shape) {
    if (dim < 0) return std::nullopt;
    count *= static_cast<long double>(dim);
  }
  if (count != static_cast<long double>(blob.data.size()) || blob.shape.size() > 32)
    return std::nullopt;
  return blob;
}

template <class Layer>
TwinLayer twin_layer(const Layer& layer) {
  TwinLayer twin{layer.name(), {}};
  for (const caffe::BlobProto& blob : layer.blobs()) twin.blobs.push_back(twin_blob(blob));
  return twin;
}

std::optional<std::vector<TwinLayer>> twin_file(const std::string& bytes) {
  caffe::NetParameter net;
  if (!net.ParsePartialFromString(bytes)) return std::nullopt;
  if ((net.layer_size() > 0) == (net.layers_size() > 0)) return std::nullopt;
  std::vector<TwinLayer> twin;
  for (const auto& layer : net.layer()) twin.push_back(twin_layer(layer));
  for (const auto& layer : net.layers()) {
    twin.push_back(layer.has_layer() ? twin_layer(layer.layer()) : twin_layer(layer));
  }
  return twin;
}

/// If protobuf reads `bytes`, results must agree. Otherwise reading must throw InputError, or
/// succeed if only skipped parts are corrupt. Returns whether the file opened.
bool agrees_with_twin(const fs::path& path, const std::string& bytes) {
  const auto twin = twin_file(bytes);
  std::unique_ptr<WeightsFile> file;
  try {
    file = WeightsFile::open(path);
  } catch (const InputError& error) {
    EXPECT_FALSE(twin) << error.what();
    return false;
  }
  if (twin) {
    EXPECT_EQ(file->layers().size(), twin->size());
  }
  for (size_t i = 0; i < file->layers().size(); ++i) {
    if (twin) {
      EXPECT_EQ(file->layers()[i].name, twin->at(i).name);
      EXPECT_EQ(file->layers()[i].n_blobs, twin->at(i).blobs.size());
    }
    try {
      const std::vector<Blob> blobs = file->read(i);
      if (!twin) continue;
      for (size_t k = 0; k < blobs.size(); ++k) {
        EXPECT_TRUE(twin->at(i).blobs.at(k) && same_blob(blobs[k], *twin->at(i).blobs[k]))
            << "blob " << k;
      }
    } catch (const InputError& error) {
      if (!twin) continue;
      const auto& blobs = twin->at(i).blobs;
      EXPECT_TRUE(std::ranges::any_of(blobs, [](const auto& blob) { return !blob; }))
          << error.what();
    }
  }
  return true;
}

std::string small_model() {
  return model_of({shape({2, 2}) + packed_data({1, 2, 3, 4}),
                   varint_field(1, 1) + varint_field(2, 1) + varint_field(3, 1) +
                       varint_field(4, 3) + unpacked_data({1, 2, 3}),
                   shape({2}) + bytes_field(8, raw<double>({1, 2})) +
                       bytes_field(6, raw<float>({1, 2}))}) +
         bytes_field(100, bytes_field(1, "r") + bytes_field(2, "ReLU") +
                              bytes_field(123, varint_field(2, 1))) +
         varint_field(200, 3) + tag(201, 3) + varint_field(1, 1) + tag(201, 4);
}
std::string small_v1_model() {
  const std::string blob = shape({2}) + packed_data({1, 2});
  return bytes_field(2, varint_field(5, 4) + bytes_field(4, "c") + bytes_field(6, blob)) +
         bytes_field(2, bytes_field(1, bytes_field(1, "d") + bytes_field(2, "conv") +
                                           bytes_field(50, blob)));
}

TEST(WeightsFileRobustness, TruncatedAtEveryByte) {
  const TempDir dir;
  for (const std::string& whole : {small_model(), small_v1_model()}) {
    write_file(dir / "w", whole);
    for (size_t length = whole.size(); length-- > 0;) {
      SCOPED_TRACE(length);
      fs::resize_file(dir / "w", length);
      agrees_with_twin(dir / "w", whole.substr(0, length));
    }
  }
}

TEST(WeightsFileRobustness, EveryValueOfEveryByte) {
  const TempDir dir;
  int opened = 0;
  for (const std::string& whole : {small_model(), small_v1_model()}) {
    ASSERT_TRUE(twin_file(whole));
    write_file(dir / "w", whole);
    for (size_t at = 0; at < whole.size(); ++at) {
      for (int value = 0; value < 256; ++value) {
        std::string damaged = whole;
        damaged[at] = static_cast<char>(value);
        patch_file(dir / "w", at, damaged[at]);
        opened += agrees_with_twin(dir / "w", damaged);
        if (::testing::Test::HasFailure()) FAIL() << "byte " << at << " = " << value;
      }
      patch_file(dir / "w", at, whole[at]);
    }
  }
  EXPECT_GT(opened, 1000);
}

TEST(WeightsFileGolden, EveryEncodingDecodesToTheSameBlobs) {
  const std::filesystem::path folder = test::golden("formats");
  const auto named = [](const fs::path& path) {
    std::map<std::string, std::vector<std::vector<float>>> blobs;
    const auto file = WeightsFile::open(path);
    for (size_t i = 0; i < file->layers().size(); ++i) {
      for (Blob& blob : file->read(i))
        blobs[file->layers()[i].name].push_back(std::move(blob.data));
    }
    return blobs;
  };
  const auto truth = named(folder / "mini_v2.caffemodel");
  EXPECT_EQ(truth.size(), 4U);
  EXPECT_EQ(truth.at("conv1").at(0).size(), 8U * 3 * 5 * 5);
  int n_files = 0;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().extension() != ".caffemodel") continue;
    SCOPED_TRACE(entry.path().string());
    ++n_files;
    EXPECT_EQ(named(entry.path()), truth);
  }
  EXPECT_EQ(n_files, 11);
}

TEST(WeightsFileGolden, LegacyShapeWins) {
  const std::filesystem::path folder = test::golden("formats");
  const auto both = WeightsFile::open(folder / "mini_v2_legacy_and_shape.caffemodel");
  for (size_t i = 0; i < both->layers().size(); ++i) {
    for (const Blob& blob : both->read(i)) EXPECT_TRUE(blob.legacy_shape);
  }
}

TEST(WeightsFileGolden, RealModelsReadAsProtobufReadsThem) {
  REVISIT_NEED_SHARED(folder, "data/caffemodels");
  int n_files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.path().extension() != ".caffemodel") continue;
    SCOPED_TRACE(entry.path().string());
    EXPECT_TRUE(agrees_with_twin(entry.path(), read_file(entry.path())));
    ++n_files;
  }
  EXPECT_GE(n_files, 6);
}

TEST(WeightsFileGolden, OneLayerOfALargeFile) {
  REVISIT_NEED_SHARED(weights, "golden/nets/vgg_cnn_s/weights.caffemodel");
  const auto file = WeightsFile::open(weights);
  const auto& layers = file->layers();
  const auto conv1 = std::ranges::find(layers, "conv1", &WeightsFile::Layer::name);
  ASSERT_NE(conv1, layers.end());
  const std::vector<Blob> blobs = file->read(static_cast<size_t>(conv1 - layers.begin()));
  EXPECT_EQ(blobs.at(0).data.size(), 96U * 3 * 7 * 7);
  EXPECT_LT(file->bytes_read(), fs::file_size(weights) / 100);
}

TEST(Binaryproto, MeanOfBothShapesEqualsItsNpy) {
  const std::filesystem::path folder = test::golden("formats");
  const Blob truth = read_npy(folder / "mean.npy");
  const Blob legacy = read_binaryproto(folder / "mean_legacy.binaryproto");
  const Blob current = read_binaryproto(folder / "mean_shape.binaryproto");
  EXPECT_EQ(legacy.data, truth.data);
  EXPECT_EQ(current.data, truth.data);
  EXPECT_TRUE(legacy.legacy_shape);
  EXPECT_FALSE(current.legacy_shape);
}

TEST(Binaryproto, DamagedFilesAreErrorsOrMeans) {
  const std::filesystem::path folder = test::golden("formats");
  const TempDir dir;
  const fs::path path = dir / "m";
  const auto is_error = [&] {
    try {
      const Blob blob = read_binaryproto(path);
      int64_t elements = 1;
      for (const int64_t dim : blob.shape) elements *= dim;
      EXPECT_EQ(static_cast<size_t>(elements), blob.data.size());
      return false;
    } catch (const InputError& error) {
      EXPECT_TRUE(std::string(error.what()).starts_with(path.string() + ": byte ")) << error.what();
      return true;
    }
  };
  for (const char* name : {"mean_legacy.binaryproto", "mean_shape.binaryproto"}) {
    const std::string whole = read_file(folder / name);
    for (size_t size = 0; size < whole.size(); ++size) {
      write_file(path, whole.substr(0, size));
      EXPECT_TRUE(is_error()) << size;
    }
    write_file(path, whole);
    for (size_t at = 0; at < whole.size(); ++at) {
      for (const char value : {'\0', '\x01', '\x08', '\x3a', '\x7f', '\x80', '\xff'}) {
        patch_file(path, at, value);
        is_error();
      }
      patch_file(path, at, whole[at]);
    }
  }
}

TEST(Binaryproto, AnotherFileInItsPlace) {
  const TempDir dir;
  write_file(dir / "m", small_model());
  contains(message_of<InputError>([&] { read_binaryproto(dir / "m"); }),
           "m: byte 0: not a binaryproto");
}

}  // namespace
}  // namespace revisit::proto
