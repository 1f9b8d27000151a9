#include "revisit/recognition/ring/model.h"

#include <ring_model.pb.h>

#include <algorithm>
#include <cmath>

#include "calibration/content.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/hash.h"
#include "ring/extraction.h"
#include "ring/spectrum.h"

namespace revisit {
namespace {

constexpr uint32_t kVersion = 2;

uint64_t checksum_of(std::string_view bytes) {
  uint64_t hash = kFnv1aStart;
  for (const char byte : bytes) hash = fnv1a(hash, static_cast<unsigned char>(byte));
  return hash;
}

using Floats = google::protobuf::RepeatedField<float>;

Floats floats_of(const std::vector<float>& values) {
  return {values.begin(), values.end()};
}

Floats floats_of(const std::vector<Eigen::MatrixXcd>& matrices, bool real) {
  Floats values;
  for (const Eigen::MatrixXcd& m : matrices)
    for (Eigen::Index i = 0; i < m.rows(); ++i)
      for (Eigen::Index j = 0; j <= i; ++j) {
        values.Add(static_cast<float>(m(i, j).real()));
        if (!real) values.Add(j < i ? static_cast<float>(m(i, j).imag()) : 0.0F);
      }
  return values;
}

void fill(const RingStatistics& from, ring::Ring& to) {
  to.set_sectors(from.sectors);
  to.set_features(from.features);
  *to.mutable_mean() = floats_of(from.mean);
  to.set_weights(from.weights);
  to.set_mirrored(from.mirrored);
  *to.mutable_total() = floats_of(from.total, from.mirrored);
  *to.mutable_shared() = floats_of(from.shared, from.mirrored);
}

void fill_extraction(const RingModel& from, ring::Model& to) {
  ring::Image& image = *to.mutable_image();
  image.set_width(from.image.width);
  image.set_height(from.image.height);
  image.set_elevation_top(from.image.elevation_top);
  image.set_elevation_bottom(from.image.elevation_bottom);
  image.set_max_range(from.image.max_range);
  image.set_closing_width(from.image.closing_width);
  image.set_closing_height(from.image.closing_height);
  to.set_prototxt(from.prototxt);
  to.set_weights(from.weights);
  to.set_weights_sha1(from.weights_sha1);
  for (const double mean : from.mean_bgr) to.add_mean_bgr(mean);
  for (const RingLayer& layer : from.layers) {
    ring::Layer& written = *to.add_layers();
    written.set_name(layer.name);
    *written.mutable_mean() = floats_of(layer.mean);
    *written.mutable_directions() = floats_of(layer.directions.values);
  }
  ring::Grid& grid = *to.mutable_grid();
  grid.set_sectors(from.grid.sectors);
  for (const double distance : from.grid.distances) grid.add_distances(distance);
  for (const double band : from.grid.bands) grid.add_bands(band);
  to.set_sensor_height(from.sensor_height);
}

struct Reader {
  const std::string& name;

  void expect(bool ok, const std::string& what) const {
    if (!ok) throw InputError(name + ": not a usable ring model: " + what);
  }
  std::vector<float> floats(const Floats& values, int64_t expected, const std::string& what) const {
    expect(values.size() == expected,
           str(what, " has ", values.size(), " values, expected ", expected));
    expect(std::ranges::all_of(values, [](float v) { return std::isfinite(v); }),
           what + " has a value that is not finite");
    return {values.begin(), values.end()};
  }
  std::vector<Eigen::MatrixXcd> matrices(const Floats& values, int64_t d, bool real,
                                         const std::string& what) const {
    const std::vector<float> all =
        floats(values, kRingFrequencies * d * (d + 1) / (real ? 2 : 1), what);
    std::vector<Eigen::MatrixXcd> result;
    auto next = all.begin();
    for (int f = 0; f < kRingFrequencies; ++f) {
      Eigen::MatrixXcd& m = result.emplace_back(d, d);
      for (int64_t i = 0; i < d; ++i)
        for (int64_t j = 0; j <= i; ++j) {
          const auto re = static_cast<double>(*next++),
                     im = real ? 0 : static_cast<double>(*next++);
          m(i, j) = {re, i == j ? 0 : im};
          m(j, i) = std::conj(m(i, j));
        }
    }
    return result;
  }
  RingStatistics ring(const ring::Ring& from, const std::string& what) const {
    constexpr int kMost = 4096;
    expect(from.sectors() >= 1 && from.sectors() <= kMost && from.features() >= 1 &&
               from.features() <= kMost,
           str(what, " of ", from.sectors(), " sectors of ", from.features(), " features"));
    expect(from.weights() >= 1 && from.features() % from.weights() == 0,
           str(what, " of ", from.features(), " features with ", from.weights(), " weights"));
    RingStatistics to;
    to.sectors = from.sectors();
    to.features = from.features();
    to.weights = from.weights();
    to.mirrored = from.mirrored();
    to.mean = floats(from.mean(), to.size(), what + " mean");
    // Sums for a descriptor are computed in float.
    expect(std::ranges::all_of(to.mean, [](float v) { return std::abs(v) <= 1e9F; }),
           what + " mean has a value above 1e9, which no scan has");
    to.total = matrices(from.total(), to.features, to.mirrored, what + " total covariance");
    for (const Eigen::MatrixXcd& total : to.total)
      expect((total.diagonal().real().array() >= 0).all(),
             what + " total covariance has a variance below 0");
    if (!from.shared().empty())
      to.shared = matrices(from.shared(), to.features, to.mirrored, what + " shared covariance");
    return to;
  }
};

}  // namespace

std::string extraction_key(const RingModel& model) {
  ring::Model message;
  fill_extraction(model, message);
  return "ring " + short_name_of(message.SerializeAsString());
}

std::string ring_model_content(const RingModel& model) {
  ring::Model message;
  fill_extraction(model, message);
  message.set_sensor(model.sensor);
  message.set_trained_on(model.trained_on);
  message.set_scans(model.scans);
  message.set_cnn_weight(model.cnn_weight);
  if (model.calibration) fill(*model.calibration, *message.mutable_calibration());
  fill(model.cnn, *message.mutable_cnn());
  fill(model.polar, *message.mutable_polar());
  ring::File whole;
  whole.set_version(kVersion);
  whole.set_model(message.SerializeAsString());
  whole.set_checksum(checksum_of(whole.model()));
  return whole.SerializeAsString();
}

void write_ring_model(const std::filesystem::path& file, const RingModel& model) {
  const std::string content = ring_model_content(model);
  write_atomically(file, [&](std::ostream& out) { out << content; });
}

RingModel parse_ring_model(std::string_view content, const std::string& name) {
  const Reader reader{name};
  ring::File whole;
  reader.expect(
      whole.ParseFromArray(content.data(), static_cast<int>(content.size())) && whole.version() > 0,
      "it is another kind of file, or truncated");
  reader.expect(whole.version() == kVersion,
                str("it has format ", whole.version(), ", this program reads format ", kVersion,
                    whole.version() < kVersion ? ": train it again and rebuild its maps"
                                               : ": update this program"));
  ring::Model from;
  reader.expect(
      checksum_of(whole.model()) == whole.checksum() && from.ParseFromString(whole.model()),
      "it is corrupt (wrong checksum)");
  RingModel to;
  to.sensor = from.sensor();
  const ring::Image& image = from.image();
  to.image = {
      image.width(),     image.height(),        image.elevation_top(), image.elevation_bottom(),
      image.max_range(), image.closing_width(), image.closing_height()};
  try {
    check_geometry(to.image);
  } catch (const UsageError& error) {
    reader.expect(false, error.what());
  }
  to.prototxt = from.prototxt();
  to.weights = from.weights();
  to.weights_sha1 = from.weights_sha1();
  reader.expect(from.mean_bgr_size() == 3, str(from.mean_bgr_size(), " means, expected 3"));
  std::ranges::copy(from.mean_bgr(), to.mean_bgr.begin());
  int64_t features = 0;
  for (const ring::Layer& layer : from.layers()) {
    const int64_t d = layer.mean_size();
    reader.expect(d > 0 && layer.directions_size() % d == 0 && layer.directions_size() > 0,
                  str("layer '", layer.name(), "' has ", layer.directions_size(),
                      " values of directions for columns of ", d));
    RingLayer& read = to.layers.emplace_back();
    read.name = layer.name();
    read.mean = reader.floats(layer.mean(), d, layer.name() + " mean");
    read.directions = FloatMatrix(layer.directions_size() / d, d);
    read.directions.values =
        reader.floats(layer.directions(), layer.directions_size(), layer.name() + " directions");
    features += read.directions.n;
  }
  const ring::Grid& grid = from.grid();
  to.grid = {grid.sectors(),
             {grid.distances().begin(), grid.distances().end()},
             {grid.bands().begin(), grid.bands().end()}};
  to.sensor_height = from.sensor_height();
  to.cnn_weight = from.cnn_weight();
  to.cnn = reader.ring(from.cnn(), "the CNN ring");
  to.polar = reader.ring(from.polar(), "the polar ring");
  const auto ascending = [](const std::vector<double>& values) {
    return std::ranges::all_of(values, [](double v) { return std::isfinite(v); }) &&
           std::ranges::adjacent_find(values, std::greater_equal()) == values.end();
  };
  reader.expect(to.grid.distances.size() >= 2 && to.grid.distances.front() >= 0 &&
                    ascending(to.grid.distances) && ascending(to.grid.bands) &&
                    std::isfinite(to.sensor_height),
                "the borders of its grid do not ascend");
  reader.expect(to.cnn_weight >= 0 && to.cnn_weight <= 1,
                "the weight of the CNN ring is not in 0 to 1");
  reader.expect(to.cnn.features == features && to.cnn.weights == 1 &&
                    to.polar.features == to.grid.features() && to.polar.weights == to.grid.bins() &&
                    to.polar.sectors == to.grid.sectors,
                "its rings do not match its layers and grid");
  reader.expect(to.cnn.shared.empty() == to.polar.shared.empty(),
                "only one of its rings was trained on pairs");
  to.trained_on = from.trained_on();
  to.scans = from.scans();
  if (from.has_calibration()) to.calibration = calibration_from(from.calibration(), name);
  return to;
}

RingModel read_ring_model(const std::filesystem::path& file) {
  return parse_ring_model(read_content(file), file.string());
}

}  // namespace revisit
