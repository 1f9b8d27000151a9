#include "features.h"

#include <nanobind/stl/array.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <filesystem>
#include <optional>

#include "listener.h"
#include "module.h"
#include "points.h"
#include "record.h"
#include "revisit/baselines/m2dp.h"
#include "revisit/baselines/scan_context.h"
#include "revisit/recognition/ring/features.h"
#include "strings.h"

namespace revisit::python {
namespace {

namespace fs = std::filesystem;
using namespace nb::literals;
using namespace pipeline;

FeatureExtractor rings(const RingModel& model, const engine::Net* net, int numbers,
                       double regularisation, double adapt, int64_t key_candidates, int threads,
                       engine::Precision precision) {
  return ring_recogniser(model, net ? *net : ring_net(model),
                         {numbers, regularisation, adapt, key_candidates},
                         {.threads = threads, .precision = precision});
}

void bind_extractors(nb::module_& module) {
  nb::class_<FeatureExtractor>(module, "FeatureExtractor",
                               "A way to turn scans into feature vectors.")
      .def_ro("name", &FeatureExtractor::name)
      .def_ro("key", &FeatureExtractor::key, "Names all that the values depend on.")
      .def_ro("dim", &FeatureExtractor::dim, "Numbers of a feature.")
      .def("__repr__", [](const FeatureExtractor& extractor) {
        return str("<FeatureExtractor '", extractor.name, "', ", extractor.dim, " numbers>");
      });
  nb::class_<ScanFeature>(module, "ScanFeature",
                          "The way from a scan to its feature. Threads take turns; make one for "
                          "each thread.")
      .def(
          "__call__",
          [](ScanFeature& self, PointsArgument points) {
            const PointCloud cloud = GivenPoints(points).cloud();
            std::vector<float> feature = without_lock([&] { return self.of(cloud); });
            const auto dim = static_cast<int64_t>(feature.size());
            return array_of(std::move(feature), {dim});
          },
          "points"_a, "The feature of a scan. InputError for one that cannot be described.");
  module.def(
      "from_scan",
      [](const FeatureExtractor& extractor, const std::string& align,
         const ImageGeometry& geometry) {
        return std::make_unique<ScanFeature>(extractor, parse_align_case(align), geometry);
      },
      "extractor"_a, "align"_a = "none", "geometry"_a = ImageGeometry(),
      "The whole way from a scan to its feature: aligned, projected, described. Features that see "
      "points take no notice of `geometry`.");
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
      "The output of a network on the range image, flattened: the paper's feature. `net_key` "
      "identifies the weights.");
  module.def("range_vector_features", &range_vector_features, "geometry"_a = ImageGeometry(),
             "The range image itself as a vector.");
}

void bind_rings(nb::module_& module) {
  nb::class_<RingModel>(module, "RingModel", "What was learnt for scans of one sensor.")
      .def_ro("sensor", &RingModel::sensor)
      .def_ro("image", &RingModel::image)
      .def_ro("learnt_from", &RingModel::learnt_from)
      .def_ro("scans", &RingModel::scans, "That it was learnt from.")
      .def_prop_ro("dim", &RingModel::dim, "Numbers of a scan's feature.")
      .def("__repr__", [](const RingModel& model) {
        return str("<RingModel for ", model.sensor, ", from ", model.scans, " scans>");
      });
  module.def("shipped_ring_sensor", &shipped_ring_sensor, "key"_a,
             "The sensor whose shipped model makes features of this key; '' when none does.");
  module.def("shipped_ring_models", &shipped_ring_models,
             "The sensors whose models come with the library.");
  module.def("shipped_ring_model", &shipped_ring_model, "sensor"_a, "weights_sha1"_a = "",
             "A model that comes with the library: of one convolution with random weights, or with "
             "the SHA-1 of SqueezeNet v1.0's weights of that.");
  module.def("read_ring_model", &read_ring_model, "file"_a,
             "A model that `revisit train` wrote. InputError naming the file and what is wrong.");
  module.def(
      "ring_net",
      [](const RingModel& model, const std::optional<fs::path>& weights) {
        return ring_net(model, weights.value_or(""));
      },
      nb::call_guard<Unlocked>(), "model"_a, "weights"_a.none() = nb::none(),
      "The net of a model: its own, or from the weights file given.");
  module.def("ring_recogniser", &rings, nb::call_guard<Unlocked>(), "model"_a,
             "net"_a.none() = nb::none(), nb::kw_only(), "numbers"_a = RingOptions().numbers,
             "regularisation"_a = RingOptions().regularisation, "adapt"_a = RingOptions().adapt,
             "key_candidates"_a = RingOptions().key_candidates, "threads"_a = 1,
             "precision"_a = engine::Precision::kFloat32,
             "Rings: places are found from either direction, and the heading between two scans.\n\n"
             "key_candidates: how many places are compared, those with the most similar keys; 0: "
             "all.");
}

void bind_baselines(nb::module_& module) {
  bind_record<ScanContextOptions>(
      module, "ScanContextOptions", "Scan Context's numbers.",
      scan_context_features,  // which checks them
      Field{"rings", &ScanContextOptions::rings}, Field{"sectors", &ScanContextOptions::sectors},
      Field{"max_range", &ScanContextOptions::max_range},
      Field{"sensor_height", &ScanContextOptions::sensor_height},
      Field{"ring_key_candidates", &ScanContextOptions::ring_key_candidates});
  module.def(
      "scan_context",
      [](PointsArgument points, const ScanContextOptions& options) {
        const PointCloud cloud = GivenPoints(points).cloud();
        std::vector<float> context(static_cast<size_t>(options.rings) *
                                   static_cast<size_t>(options.sectors));
        without_lock([&] { scan_context(cloud, options, context); });
        return array_of(std::move(context), {options.rings, options.sectors});
      },
      "points"_a, "options"_a = ScanContextOptions(),
      "Heights of the highest points of each bin [rings][sectors] (G. Kim, A. Kim, IROS 2018).");
  module.def(
      "context_distance",
      [](GivenFloats a, GivenFloats b, const ScanContextOptions& options) {
        const auto x = contiguous_floats(a, "a"), y = contiguous_floats(b, "b");
        const std::vector<int64_t> expected = {options.rings, options.sectors};
        if (shape_of(x) != expected || shape_of(y) != expected)
          throw value_error(str("context_distance: expected two arrays of shape ", options.rings,
                                "x", options.sectors, ", found ", description_of(a), ", ",
                                description_of(b)));
        const ContextDistance found =
            context_distance({x.data(), x.size()}, {y.data(), y.size()}, options);
        return std::pair(found.distance, found.shift);
      },
      "a"_a, "b"_a, "options"_a = ScanContextOptions(),
      "Distance 0 (the same) to 2 of two contexts, and the columns that the first is moved to the "
      "left to meet the second.");
  module.def("scan_context_features", &scan_context_features, "options"_a = ScanContextOptions(),
             "Scan Context as a feature.");
  module.def("m2dp_features", &m2dp_features, "M2DP as a feature (He et al., IROS 2016).");
}

}  // namespace

void bind_features(nb::module_& module) {
  bind_extractors(module);
  bind_rings(module);
  bind_baselines(module);
}

}  // namespace revisit::python
