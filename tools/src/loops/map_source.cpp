#include "map_source.h"

#include <cstdlib>
#include <exception>
#include <iterator>

#include "cli/built_in.h"
#include "cli/terminal.h"
#include "models/models.h"
#include "revisit/base/error.h"
#include "revisit/recognition/align.h"
#include "revisit/recognition/feature_file.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

FeatureExtractor projected(const FeatureExtractor& extractor, const MapOptions& options,
                           const fs::path& folder, int64_t components) {
  const auto model = std::make_shared<const PcaModel>(folder);
  if (model->dim() != extractor.dim)
    throw InputError(folder.string(), ": the PCA does not fit the feature ", extractor.name,
                     " (expected ", extractor.dim, " dimensions, found ", model->dim(), ")");
  FeatureExtractor result;
  result.name = extractor.name;
  result.key = str(extractor.key, ", PCA ", models::file_sha1(folder / "mean.npy"), " ",
                   models::file_sha1(folder / "basis.npy"));
  result.dim = components > 0 ? std::min(components, model->components()) : model->components();
  result.make = [extractor, options, model]() -> FeatureFunction<PointCloud> {
    return [describe = from_scan(extractor, options.align, options.geometry), model,
            whole = std::vector<float>(static_cast<size_t>(extractor.dim))](
               const PointCloud& cloud, std::span<float> descriptor) mutable {
      describe(cloud, whole);
      model->project(whole, descriptor);
    };
  };
  return result;
}

class ScratchFolder {
 public:
  ScratchFolder() {
    std::error_code error;
    std::string name = (fs::temp_directory_path(error) / "revisit-pca-XXXXXX").string();
    if (error || ::mkdtemp(name.data()) == nullptr)
      throw Error(name, ": cannot create the folder; set TMPDIR to one that can be written");
    path = name;
  }
  ~ScratchFolder() {
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  fs::path path;
};

/// PCA of some features. With fewer than `enough` features all descriptors are zero, because by a
/// few components all scans look alike.
Projection pca_of(const Rows& features, std::span<const int64_t> fit_rows, int64_t enough,
                  int64_t components, int threads) {
  const auto n = std::ssize(fit_rows);
  Projection projection;
  projection.dim = components;
  projection.describe = [](std::span<const float>, std::span<float> descriptor) {
    std::ranges::fill(descriptor, 0.0F);
  };
  if (n < enough) return projection;
  const ScratchFolder scratch;
  FeatureWriter writer(scratch.path / "features", "", n, features.d);
  for (const int64_t row : fit_rows) writer.append(features.row(row));
  writer.finish();
  const FeatureFile file(scratch.path / "features");
  fit_pca({&file}, {.components = components, .threads = threads, .model_folder = scratch.path});
  // The model keeps its files open.
  const auto model = std::make_shared<const PcaModel>(scratch.path);
  projection.describe = [model](std::span<const float> feature, std::span<float> descriptor) {
    const auto there = static_cast<size_t>(model->components());
    std::ranges::fill(descriptor, 0.0F);
    model->project(feature, descriptor.first(std::min(there, descriptor.size())));
  };
  return projection;
}

/// Chooses the model for local maps of any sensor (docs/SLAM.md), or the map's.
void choose_local_map_sensor(FeatureOptions& o, const std::string& map_key) {
  if (o.feature != "ring" || !o.ring.empty() || !o.image.is_auto()) return;
  const std::string of_map = shipped_ring_sensor(map_key);
  o.image.sensor = of_map.empty() ? "hdl64" : of_map;
  if (!o.quiet)
    note(str("sensor: ", o.image.sensor, of_map.empty() ? " (of local maps)" : " (of the map)"));
}

}  // namespace

MapSource map_source(FeatureOptions& options, const Dataset& some, const std::string& map_key,
                     ScansAtOnce at_once, std::optional<int64_t> warmup) {
  if (options.feature == "fabmap")
    throw UsageError(
        "--feature fabmap: needs all camera images of a drive at once; use `revisit eval "
        "--protocol online`");
  if (options.local_map != 0) choose_local_map_sensor(options, map_key);
  warn_of_view(options, some);
  if (const std::string found = resolve_sensor(options, some, map_key);
      !found.empty() && !options.quiet)
    note("sensor: " + found);
  options.threads_per_scan = at_once == ScansAtOnce::kOne ? options.thread_count() : 1;
  MapSource result{open_feature(options, some, ""), {}};
  result.options.align = result.align;
  result.options.geometry = options.image.geometry();
  result.options.local_map = options.local_map;
  if (!options.mount.empty()) result.options.mount = parse_mount(options.mount);
  if (result.components < 0) return result;
  const bool no_folder = options.fitted_on() == "all" || options.fitted_on() == "map";
  if (no_folder && warmup) {
    constexpr int64_t kAll = 400;
    const int64_t components = result.components > 0 ? result.components : kAll;
    result.options.warmup = *warmup;
    result.extractor.fit_projection = [enough = *warmup, components,
                                       threads = options.thread_count()](
                                          const Rows& features, std::span<const int64_t> fit_rows) {
      return pca_of(features, fit_rows, enough, components, threads);
    };
    return result;
  }
  if (no_folder)
    throw UsageError("--feature ", options.feature,
                     ": needs an existing PCA; give the folder that `revisit eval --descriptors` "
                     "wrote with --pca, or --pca none");
  result.extractor =
      projected(result.extractor, result.options, options.fitted_on(), result.components);
  result.options.align = AlignCase::kNone;  // done in the feature
  return result;
}

void MapArguments::declare(Options& options) {
  options.group("Map:")
      .option("map", "FILE",
              "map file, created if missing, or postgresql://HOST/DATABASE?map=NAME, shared with "
              "other robots (default: none)",
              &file)
      .common()
      .option("projection-from", "MAP",
              "map whose descriptor projection a new map takes over, so that both can be merged",
              &projection)
      .needs("map")
      .option("drive", "NAME",
              "name of this recording in the map; a number is added to a name in use (default: its "
              "sequence or folder)",
              &drive)
      .common()
      .option("warmup", "N",
              "distinct map entries that the map mean is estimated from (default 128)", &warmup)
      .flag("no-clouds",
            "no points in the map, 3 to 24 kB per entry; loops are then not registered", &no_clouds)
      .choice<DescriptorType>(
          "dtype", {{"float32", DescriptorType::kFloat32}, {"float16", DescriptorType::kFloat16}},
          "data type of descriptors in a new map (default float32)", &dtype)
      .check([this] {
        need_built_in_for_map("--map", file);
        need_built_in_for_map("--projection-from", projection);
      });
}

std::unique_ptr<MapStore> MapArguments::open(const MapSource& source) const {
  if (file.empty()) return nullptr;
  const MapFingerprint fingerprint = fingerprint_of(source.extractor, source.options);
  if (!projection.empty()) projection_of(projection, fingerprint);  // before a map is created
  auto map =
      open_map(file, MapAccess::kWrite, &fingerprint, dtype.value_or(DescriptorType::kFloat32));
  if (dtype && *dtype != map->descriptor_type())
    throw InputError("--dtype ", name_of(*dtype), ": the map ", display_name(file), " has ",
                     name_of(map->descriptor_type()),
                     ", and only a new map can have another; leave it out, or give another --map");
  if (!projection.empty()) copy_projection(*map, projection, warn);
  return map;
}

NewMap::NewMap(const std::filesystem::path& map) : exceptions_(std::uncaught_exceptions()) {
  std::error_code unknown;
  if (!is_server_address(map.string()) && !std::filesystem::exists(map, unknown) && !unknown)
    file_ = map;
}

NewMap::~NewMap() {
  if (file_.empty() || std::uncaught_exceptions() == exceptions_) return;
  try {
    const auto map = open_map(file_, MapAccess::kWrite);  // no other process writes now
    if (map->size() > 0) return;
    for (const char* part : {"", "-wal", "-shm"}) std::filesystem::remove(file_.string() + part);
  } catch (const std::exception&) {  // no map was created, or another process uses it
  }
}

}  // namespace revisit::cli
