#include <nanobind/stl/array.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <mutex>
#include <optional>
#include <vector>

#include "module.h"
#include "points.h"
#include "revisit/baselines/baselines.h"
#include "revisit/recognition/feature.h"
#include "revisit/recognition/feature_file.h"
#include "revisit/recognition/ring/descriptor.h"
#include "unlocked.h"

namespace revisit::python {

/// Thread-safe: concurrent calls are serialized.
class ScanFeature {
 public:
  ScanFeature(const FeatureExtractor& extractor, AlignCase align, const ImageGeometry& geometry)
      : dim_(extractor.dim), describe_(from_scan(extractor, align, geometry)) {}

  std::vector<float> of(const PointCloud& cloud) {
    std::vector<float> feature(static_cast<size_t>(dim_));
    const std::lock_guard lock(mutex_);
    describe_(cloud, feature);
    return feature;
  }

 private:
  int64_t dim_;
  std::mutex mutex_;
  FeatureFunction<PointCloud> describe_;
};

namespace {

namespace fs = std::filesystem;
using namespace nb::literals;

FeatureExtractor rings(const RingModel& model, const engine::Net* net, int dim,
                       double regularization, double blend, int64_t candidates, int threads,
                       engine::Precision precision) {
  return ring_recognizer(model, net ? *net : ring_net(model),
                         {dim, regularization, blend, candidates},
                         {.threads = threads, .precision = precision});
}

void bind_extractors(nb::module_& module) {
  nb::class_<FeatureExtractor>(module, "FeatureExtractor",
                               "A method that computes feature vectors of scans.")
      .def_ro("name", &FeatureExtractor::name, "Name, for display.")
      .def_ro("key", &FeatureExtractor::key, "Identifies everything that the values depend on.")
      .def_ro("dim", &FeatureExtractor::dim, "Dimensions of a feature.")
      .def("__repr__", [](const FeatureExtractor& extractor) {
        return str("<FeatureExtractor '", extractor.name, "', ", extractor.dim, " dimensions>");
      });
  nb::class_<ScanFeature>(module, "ScanFeature",
                          "Computes the feature of a scan. Calls are serialized; create one per "
                          "thread.")
      .def(
          "__call__",
          [](ScanFeature& self, PointsArgument points) {
            const PointCloud cloud = GivenPoints(points).cloud();
            return array_of(without_lock([&] { return self.of(cloud); }));
          },
          "points"_a,
          "Returns the feature of a scan. Raises InputError if it cannot be described.");
  module.def(
      "from_scan",
      [](const FeatureExtractor& extractor, const std::string& align,
         const ImageGeometry& geometry) {
        return std::make_unique<ScanFeature>(extractor, parse_align_case(align), geometry);
      },
      "extractor"_a, "align"_a = "none", "geometry"_a = ImageGeometry(),
      "Returns a function from a scan to its feature, which aligns, projects and describes. "
      "Features computed from points ignore `geometry`. Raises UsageError for a feature of "
      "images.");
  module.def(
      "network_features",
      [](const engine::Net& net, const std::string& net_key, const std::array<double, 3>& mean_bgr,
         const ImageGeometry& geometry, int threads, engine::Precision precision,
         double input_scale) {
        return network_features(net, net_key, mean_bgr, geometry,
                                {.threads = threads, .precision = precision}, input_scale);
      },
      nb::call_guard<Unlocked>(), "net"_a, "net_key"_a, nb::kw_only(), "mean_bgr"_a,
      "geometry"_a = ImageGeometry(), "threads"_a = 1, "precision"_a = engine::Precision::kFloat32,
      "input_scale"_a = 1.0,
      "The paper's feature: flattened output of a network on the range image. `net_key` identifies "
      "the weights. mean_bgr: 0 to 255. Raises InputError unless the net has one input of 1 or 3 "
      "channels.");
}

void bind_rings(nb::module_& module) {
  nb::class_<RingModel>(module, "RingModel", "Ring descriptor model, trained for one sensor.")
      .def_ro("sensor", &RingModel::sensor, "Sensor that it was trained for.")
      .def_ro("image", &RingModel::image, "Geometry of its range images.")
      .def_ro("trained_on", &RingModel::trained_on, "Description of the training data.")
      .def_ro("scans", &RingModel::scans, "Number of training scans.")
      .def_prop_ro("dim", &RingModel::dim, "Dimensions of a scan's feature.")
      .def("__repr__", [](const RingModel& model) {
        return str("<RingModel for ", model.sensor, ", from ", model.scans, " scans>");
      });
  module.def("shipped_ring_sensor", &shipped_ring_sensor, "key"_a,
             "Returns the sensor whose shipped model makes features with this key; '' if none.");
  module.def("shipped_ring_models", &shipped_ring_models,
             "Lists the sensors whose models come with the library.");
  module.def("shipped_ring_model", &shipped_ring_model, "sensor"_a, "weights_sha1"_a = "",
             "Returns a model that comes with the library. Its net is one convolution with random "
             "weights, or SqueezeNet v1.0 if `weights_sha1` is the SHA-1 of its weights. Raises "
             "UsageError for another sensor.");
  module.def("read_ring_model", &read_ring_model, "file"_a,
             "Reads a model that `revisit train` wrote. Raises InputError with the file and the "
             "defect.");
  module.def(
      "ring_net",
      [](const RingModel& model, const std::optional<fs::path>& weights) {
        return ring_net(model, weights.value_or(""));
      },
      nb::call_guard<Unlocked>(), "model"_a, "weights"_a.none() = nb::none(),
      "Returns the net of a model: its own, or the one with the given weights file. Raises "
      "InputError if it has none, or they do not match.");
  module.def("ring_recognizer", &rings, nb::call_guard<Unlocked>(), "model"_a,
             "net"_a.none() = nb::none(), nb::kw_only(), "dim"_a = RingOptions().dim,
             "regularization"_a = RingOptions().regularization, "blend"_a = RingOptions().blend,
             "candidates"_a = RingOptions().candidates, "threads"_a = 1,
             "precision"_a = engine::Precision::kFloat32,
             "Ring descriptors, which recognize places under any yaw and give the relative yaw.\n\n"
             "candidates: number of places compared exactly, preselected by compact codes; 0: "
             "all. Raises UsageError for invalid options.");
}

void bind_baselines(nb::module_& module) {
  bind_record<ScanContextOptions>(
      module, "ScanContextOptions", "Parameters of Scan Context.",
      scan_context_features,  // checks them
      Field{"rings", &ScanContextOptions::rings, "Radial bins."},
      Field{"sectors", &ScanContextOptions::sectors, "Azimuth sectors."},
      Field{"max_range", &ScanContextOptions::max_range, "Farther points are ignored [m]."},
      Field{"sensor_height", &ScanContextOptions::sensor_height,
            "Added to z, so that heights are positive [m]."},
      Field{"candidates", &ScanContextOptions::candidates,
            "Candidates by ring keys; 0: all are compared."});
  module.def("scan_context_features", &scan_context_features, "options"_a = ScanContextOptions(),
             "Scan Context as a feature extractor (Kim and Kim, IROS 2018).");
  module.def("m2dp_features", &m2dp_features,
             "M2DP as a feature extractor (He et al., IROS 2016).");
}

struct Files {
  std::vector<FeatureFile> files;
  FeatureFiles all;
  explicit Files(const std::vector<fs::path>& paths) {
    files.reserve(paths.size());
    for (const fs::path& path : paths) all.push_back(&files.emplace_back(path));
  }
};

int64_t bytes_of_gigabytes(double gigabytes) {
  if (!std::isfinite(gigabytes) || gigabytes <= 0)
    throw UsageError("memory_gb: expected more than 0, found ", gigabytes);
  return static_cast<int64_t>(std::min(gigabytes * 0x1p30, 0x1p62));
}

}  // namespace

void bind_features(nb::module_& module) {
  bind_extractors(module);
  bind_rings(module);
  bind_baselines(module);
}

void bind_pca(nb::module_& module) {
  nb::class_<PcaResult>(module, "PcaResult", "Result of fit_pca().")
      .def_prop_ro(
          "descriptors",
          [](nb::handle self) {
            const FloatMatrix& matrix = nb::cast<const PcaResult&>(self).descriptors;
            return view_of(matrix.values.data(), {matrix.n, matrix.d}, self);
          },
          "Projections of all rows: float32 [n][rank], not whitened, not normalized; read-only.")
      .def_ro("rank", &PcaResult::rank, "Number of components kept.")
      .def_ro("variances", &PcaResult::variances, "Variance of each component over the fit rows.")
      .def_ro("total_variance", &PcaResult::total_variance,
              "Variance of all features; sum(variances) of it is explained.")
      .def_ro("note", &PcaResult::note,
              "Explanation if fewer components were kept than requested; else ''.");
  module.def(
      "fit_pca_of_files",
      [](const std::vector<fs::path>& files, int64_t components,
         const std::vector<int64_t>& fit_rows, const std::optional<fs::path>& model_folder,
         double memory_gb, int threads) {
        const Files features(files);
        Listener listener;
        return listener.run([&] {
          return fit_pca(features.all, {.components = components,
                                        .fit_rows = fit_rows,
                                        .memory = bytes_of_gigabytes(memory_gb),
                                        .threads = threads,
                                        .model_folder = model_folder.value_or(""),
                                        .stop = [&] { return listener.stop(); }});
        });
      },
      "files"_a, "components"_a, "fit_rows"_a, "model_folder"_a, "memory_gb"_a, "threads"_a,
      "See fit_pca(). files: .npy files of float32 [n][d].");
}

}  // namespace revisit::python
