#include "revisit/recognition/pca.h"

#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "arrays.h"
#include "listener.h"
#include "module.h"
#include "strings.h"

namespace revisit::python {
namespace {

namespace fs = std::filesystem;
using namespace nb::literals;

struct Files {
  std::vector<FeatureFile> files;
  FeatureFiles all;
  explicit Files(const std::vector<fs::path>& paths) {
    files.reserve(paths.size());
    for (const fs::path& path : paths) all.push_back(&files.emplace_back(path));
  }
};

int64_t bytes_of(double gigabytes) {
  if (!std::isfinite(gigabytes) || gigabytes <= 0)
    throw UsageError("memory_gb: expected more than 0, found ", gigabytes);
  return static_cast<int64_t>(std::min(gigabytes * 0x1p30, 0x1p62));
}

FloatArray array_of_matrix(FloatMatrix matrix) {
  const std::vector<int64_t> shape = {matrix.n, matrix.d};
  return array_of(std::move(matrix.values), shape);
}

}  // namespace

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
      .def_ro("total_variance", &PcaResult::total_variance)
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
                                        .memory = bytes_of(memory_gb),
                                        .threads = threads,
                                        .model_folder = model_folder.value_or(""),
                                        .stop = [&] { return listener.stop(); }});
        });
      },
      "files"_a, "components"_a, "fit_rows"_a, "model_folder"_a, "memory_gb"_a, "threads"_a);
  nb::class_<PcaModel>(module, "PcaFolder")
      .def(nb::init<const fs::path&>(), "folder"_a)
      .def_prop_ro("components", &PcaModel::components)
      .def_prop_ro("dim", &PcaModel::dim)
      .def(
          "project",
          [](const PcaModel& model, const std::vector<fs::path>& files, int64_t components,
             int threads) {
            const Files features(files);
            Listener listener;
            return array_of_matrix(listener.run([&] {
              return model.project(features.all, {.components = components,
                                                  .threads = threads,
                                                  .stop = [&] { return listener.stop(); }});
            }));
          },
          "files"_a, "components"_a, "threads"_a);
}

}  // namespace revisit::python
