#include <algorithm>
#include <memory>

#include "fabmap.h"
#include "revisit/base/error.h"
#include "revisit/base/hash.h"
#include "revisit/baselines/baselines.h"
#include "revisit/datasets/describe.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/engine/parallel_for.h"
#include "revisit/recognition/feature_file.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

std::vector<int64_t> spread(int64_t total, int64_t count) {
  count = std::min(count, total);
  std::vector<int64_t> chosen;
  for (int64_t i = 0; i < count; ++i) chosen.push_back(i * total / count);
  return chosen;
}

std::vector<FloatMatrix> describe_images(const Dataset& images, const std::vector<int64_t>& chosen,
                                         const TrainingOptions& options) {
  const auto n = static_cast<int64_t>(chosen.size());
  const Progress progress = options.observer.stage("training words", "images");
  std::vector<FloatMatrix> descriptors(chosen.size());
  const int64_t block = int64_t{options.threads} * 4;
  for (int64_t first = 0; first < n; first += block) {
    progress(first, n);
    if (options.observer.stop()) throw Interrupted("stopped while training visual words");
    const int64_t end = std::min(n, first + block);
    parallel_for(end - first, options.threads, [&](int64_t item) {
      const auto at = static_cast<size_t>(first + item);
      const ScanRef& image = images.scans[static_cast<size_t>(chosen[at])];
      descriptors[at] = sift_descriptors(read_gray_png(image.file));
    });
  }
  progress(n, n);
  return descriptors;
}

/// At most `count` descriptors, evenly spaced, equally many per image.
FloatMatrix sample(const std::vector<FloatMatrix>& images, int64_t count) {
  FloatMatrix sampled(0, images[0].d);
  const int64_t of_each = std::max<int64_t>(1, count / static_cast<int64_t>(images.size()));
  for (const FloatMatrix& image : images)
    for (const int64_t row : spread(image.n, of_each)) {
      sampled.values.insert(sampled.values.end(), image.row(row).begin(), image.row(row).end());
      ++sampled.n;
    }
  return sampled;
}

FloatMatrix read_matrix(const fs::path& file) {
  const FeatureFile rows(file);
  return rows.matrix(0, rows.n(), rows.d());
}

void write_matrix(const fs::path& file, const std::string& key, const FloatMatrix& matrix) {
  FeatureWriter writer(file, key, matrix.n, matrix.d);
  for (int64_t i = writer.rows_written(); i < matrix.n; ++i) writer.append(matrix.row(i));
  writer.finish();
}

void check(const Dataset& images, const TrainingOptions& options) {
  if (images.scans.empty()) throw InputError("FAB-MAP: expected training images, found none");
  if (options.words < 1 || options.images < 1 || options.descriptors < 1 || options.threads < 1)
    throw UsageError("FAB-MAP: expected at least one word, image, descriptor and thread; found ",
                     options.words, ", ", options.images, ", ", options.descriptors, " and ",
                     options.threads);
}

}  // namespace

WordModel train_vocabulary(const Dataset& images, const TrainingOptions& options,
                           const fs::path& folder) {
  check(images, options);
  WordModel model;
  model.key = str("version ", kFeatureVersion, " words ", options.words, " images ", options.images,
                  " descriptors ", options.descriptors, " seed ", options.seed, " of ",
                  dataset_key(images));
  const std::string name = short_name_of(model.key);
  const fs::path vocabulary_file = folder / str("fabmap-", name, "-vocabulary.features");
  const fs::path images_file = folder / str("fabmap-", name, "-images.features");
  if (features_complete(vocabulary_file, model.key) && features_complete(images_file, model.key)) {
    model.vocabulary = read_matrix(vocabulary_file);
    model.images = read_matrix(images_file);
    return model;
  }
  const std::vector<int64_t> chosen =
      spread(static_cast<int64_t>(images.scans.size()), options.images);
  const std::vector<FloatMatrix> descriptors = describe_images(images, chosen, options);
  model.vocabulary =
      cluster_words(sample(descriptors, options.descriptors), options.words, options.seed);
  model.images = FloatMatrix(static_cast<int64_t>(chosen.size()), options.words);
  for (size_t i = 0; i < descriptors.size(); ++i)
    find_words(descriptors[i], model.vocabulary, model.images.row(static_cast<int64_t>(i)));
  write_matrix(vocabulary_file, model.key, model.vocabulary);
  write_matrix(images_file, model.key, model.images);
  return model;
}

FeatureExtractor word_features(const WordModel& model, bool sampled) {
  const auto shared = std::make_shared<const WordModel>(model);
  const auto map = std::make_shared<const FabMap>(chow_liu_tree(model.images), FabMapOptions(),
                                                  sampled ? model.images : FloatMatrix());
  FeatureExtractor extractor;
  extractor.name = "fabmap";
  extractor.dim = map->words();
  extractor.key = "fabmap " + model.key;  // the words only
  extractor.similarity_is_probability = true;
  extractor.make = [shared]() -> FeatureFunction<GrayImage> {
    return [shared](const GrayImage& image, std::span<float> seen) {
      find_words(sift_descriptors(image), shared->vocabulary, seen);
    };
  };
  extractor.comparison.similarity =
      [map](std::span<const float> query, std::span<const std::span<const float>> places,
            std::span<double> similarities) { map->posterior(query, places, similarities); };
  return extractor;
}

FeatureExtractor fabmap_features(const Dataset& images, bool sampled, const fs::path& folder,
                                 int threads, const Observer& observer) {
  const TrainingOptions options{.threads = threads, .observer = observer};
  return word_features(train_vocabulary(images, options, folder), sampled);
}

}  // namespace revisit
