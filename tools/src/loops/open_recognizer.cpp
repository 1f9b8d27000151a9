#include "open_recognizer.h"

#include "cli/messages.h"
#include "models/checksum.h"
#include "revisit/recognition/mount.h"
#include "revisit/recognition/pca.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

/// The feature after a PCA that was learnt before.
pipeline::FeatureExtractor projected(const pipeline::FeatureExtractor& extractor,
                                     const pipeline::RecognizerOptions& options,
                                     const fs::path& folder, int64_t components) {
  const auto model = std::make_shared<const pipeline::PcaModel>(folder);
  if (model->dim() != extractor.dim)
    throw InputError(folder.string(), ": a PCA for ", model->dim(), " numbers, the feature ",
                     extractor.name, " has ", extractor.dim);
  pipeline::FeatureExtractor result;
  result.name = extractor.name;
  result.key = str(extractor.key, ", PCA ", models::file_sha1(folder / "mean.npy"), " ",
                   models::file_sha1(folder / "basis.npy"));
  result.dim = components > 0 ? std::min(components, model->components()) : model->components();
  result.make = [extractor, options, model]() -> pipeline::FeatureFunction<pipeline::PointCloud> {
    return [describe = pipeline::from_scan(extractor, options.align, options.geometry), model,
            whole = std::vector<float>(static_cast<size_t>(extractor.dim))](
               const pipeline::PointCloud& cloud, std::span<float> descriptor) mutable {
      describe(cloud, whole);
      model->project(whole, descriptor);
    };
  };
  return result;
}

}  // namespace

RecognizerSource recognizer_source(FeatureOptions& options, const pipeline::Dataset& some,
                                   const fs::path& map, ScansAtOnce at_once) {
  if (options.feature == "fabmap")
    throw UsageError("--feature fabmap: it sees camera images, and all of them at once");
  warn_of_view(options, some);
  if (const std::string found = resolve_sensor(options, some, map);
      !found.empty() && !options.quiet)
    note("sensor: " + found);
  options.threads_per_scan = at_once == ScansAtOnce::kOne ? options.thread_count() : 1;
  FeatureSource source = open_feature(options, some, "");
  RecognizerSource result{std::move(source.extractor), {}};
  result.options.align = source.align;
  result.options.geometry = options.image.geometry();
  if (!options.mount.empty()) result.options.mount = pipeline::parse_mount(options.mount);
  if (source.components < 0) return result;
  if (options.fit_on == "all" || options.fit_on == "map")
    throw UsageError("--feature ", options.feature,
                     ": the PCA must be learnt before: give its folder with --fit-on, as "
                     "`revisit describe` writes it, or --pca none");
  result.extractor = projected(result.extractor, result.options, options.fit_on, source.components);
  result.options.align = pipeline::AlignCase::kNone;  // done in the feature
  return result;
}

}  // namespace revisit::cli
