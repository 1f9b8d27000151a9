#include "revisit/evaluation/descriptors.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "revisit/base/error.h"
#include "revisit/base/hash.h"
#include "revisit/recognition/feature_file.h"

namespace revisit {

std::vector<int64_t> skipped_rows(DatasetFeatures& case1, DatasetFeatures* case2) {
  std::vector<int64_t> rows = case1.skipped();
  if (!case2) return rows;
  std::vector<int64_t> all;
  std::ranges::set_union(rows, case2->skipped(), std::back_inserter(all));
  return all;
}

namespace {

namespace fs = std::filesystem;

FloatMatrix rows_of(const FloatMatrix& all, int64_t first, int64_t count) {
  FloatMatrix part(count, all.d);
  std::copy_n(all.values.begin() + first * all.d, count * all.d, part.values.begin());
  return part;
}

FloatMatrix all_rows(const FeatureFile& file, double memory_gb) {
  const double gigabytes = 4e-9 * static_cast<double>(file.n()) * static_cast<double>(file.d());
  if (gigabytes > memory_gb)
    throw UsageError("memory: ", file.path().string(), " takes ", gigabytes, " GB, more than the ",
                     memory_gb, " allowed");
  return file.matrix(0, file.n(), file.d());
}

/// Zeros make a scan that could not be described dissimilar to all, also after a projection.
void clear_rows(FloatMatrix& matrix, const std::vector<int64_t>& rows) {
  for (const int64_t row : rows) std::ranges::fill(matrix.row(row), 0.0F);
}

std::string fit_text(const ReductionOptions& options, int64_t scans, int64_t components) {
  return str(options.fit_on, ": ", scans, " scans, ", components, " components");
}

/// Case 1 only, also if case 2 is present.
std::vector<int64_t> training_rows(const ReductionOptions& options, const Task& task, int64_t n,
                                   const std::vector<int64_t>& skipped) {
  if (options.fit_on == "map") return task.stored;
  std::vector<int64_t> rows;
  for (int64_t row = 0; row < n; ++row)
    if (!std::ranges::binary_search(skipped, row)) rows.push_back(row);
  return rows;
}

/// Must be raised with every change of this file or of the PCA that changes descriptors.
constexpr int kDescriptorVersion = 1;

/// Key of everything that descriptors depend on except the number of components.
std::string descriptor_key(const ReductionOptions& options, const Task& task,
                           const DatasetFeatures& case1, const DatasetFeatures* case2) {
  std::string key = str("descriptors ", kDescriptorVersion, "\n", case1.key(),
                        case2 ? case2->key() : "", "pca-fit ", options.fit_on, "\n");
  if (options.fit_on == "map")
    for (const int64_t row : task.stored) key += str(row, " ");
  return key;
}

fs::path descriptor_file(const fs::path& cache, const std::string& key, int64_t components) {
  return cache / str("descriptors-", short_name_of(key), "-", components ? str(components) : "all",
                     ".features");
}

void write_rows(FeatureWriter& writer, const FloatMatrix& rows, int64_t first) {
  for (int64_t i = std::max<int64_t>(0, writer.rows_written() - first); i < rows.n; ++i)
    writer.append(rows.row(i));
}

void check_finite(const FloatMatrix& descriptors, int which_case) {
  const auto bad = std::find_if_not(descriptors.values.begin(), descriptors.values.end(),
                                    [](float value) { return std::isfinite(value); });
  if (bad == descriptors.values.end()) return;
  const int64_t at = bad - descriptors.values.begin();
  throw Error("the descriptor of scan ", at / descriptors.d, " (alignment case ", which_case,
              "), value ", at % descriptors.d, ": ", *bad, " is not finite");
}

/// Large values in a PCA model can overflow; raw features of a network are unbounded.
Descriptors checked(Descriptors descriptors) {
  check_finite(descriptors);
  return descriptors;
}

/// Descriptors with all components serve any smaller number.
std::optional<Descriptors> cached(const ReductionOptions& options, const Task& task,
                                  const fs::path& cache, const std::string& key,
                                  DatasetFeatures& case1, DatasetFeatures* case2,
                                  const Observer& observer) {
  const int64_t requested = options.components;
  for (const int64_t there : {requested, int64_t{0}}) {
    const fs::path path = descriptor_file(cache, key, there);
    if (!features_complete(path, str(key, "\n", there))) {
      if (fs::exists(fs::symlink_status(path)))
        observer.note(path.string() + " does not match what was written; it is computed again");
      continue;
    }
    const FeatureFile file(path);
    const int64_t columns = requested ? std::min(requested, file.d()) : file.d();
    const int64_t n = case1.n();
    const auto fitted = std::ssize(training_rows(options, task, n, skipped_rows(case1, case2)));
    Descriptors found;
    found.case1 = file.matrix(0, n, columns);
    if (case2) found.case2 = file.matrix(n, n, columns);
    found.pca_fit = fit_text(options, fitted, columns);
    if (columns < requested)
      found.note = str("PCA keeps ", columns, " of the ", requested, " components requested");
    return found;
  }
  return {};
}

void check(const Descriptors& descriptors, const Task& task, QueryCase query_case) {
  const FloatMatrix& case1 = descriptors.case1;
  if (query_case != QueryCase::kAsStored) {
    if (!descriptors.case2) throw Error("there are no descriptors of alignment case 2");
    if (descriptors.case2->n != case1.n || descriptors.case2->d != case1.d)
      throw Error("descriptors of alignment case 2 are ", descriptors.case2->n, " x ",
                  descriptors.case2->d, ", of case 1 ", case1.n, " x ", case1.d);
  }
  check_finite(descriptors);
  const auto has_row = [&](int64_t row) { return row >= 0 && row < case1.n; };
  for (const int64_t row : task.stored)
    if (!has_row(row)) throw Error("task ", task.name, " stores scan ", row, " of ", case1.n);
  for (const TaskQuery& query : task.queries) {
    if (!has_row(query.scan))
      throw Error("task ", task.name, " asks scan ", query.scan, " of ", case1.n);
    for (const CandidateRange& range : query.candidates)
      if (range.begin < 0 || range.end < range.begin ||
          range.end > static_cast<int64_t>(task.stored.size()))
        throw Error("task ", task.name, ": scan ", query.scan, " has candidates [", range.begin,
                    ", ", range.end, ") of ", task.stored.size());
    if (query.n_candidates() == 0)
      throw Error("task ", task.name, ": scan ", query.scan, " has no candidates");
  }
}

/// If compact codes preselected fewer than k candidates, appends the first of the others.
void add_skipped(Match& match, const TaskQuery& query, const SearchOptions& options) {
  const auto wanted = static_cast<size_t>(std::min<int64_t>(options.k, query.n_candidates()));
  const std::vector<int64_t> chosen = match.ranks;
  for (const CandidateRange& range : query.candidates)
    for (int64_t place = range.begin; place < range.end && match.ranks.size() < wanted; ++place) {
      if (std::ranges::find(chosen, place) != chosen.end()) continue;
      match.ranks.push_back(place);
      match.similarities.push_back(-1);
      if (options.score == Score::kMargin) match.score = 2 * match.similarities.front() + 1;
    }
}

/// Queries and ranks of the result are rows of the data set.
std::vector<Match> search(const PlaceIndex& index, const FloatMatrix& descriptors, int which_case,
                          const Task& task, const SearchOptions& options) {
  std::vector<Query> queries;
  for (const TaskQuery& query : task.queries)
    queries.push_back({descriptors.row(query.scan), query.candidates});
  std::vector<Match> matches = index.best_of_many(queries, options);
  for (size_t q = 0; q < matches.size(); ++q) {
    if (options.score != Score::kDistinctMargin)  // may return fewer than k
      add_skipped(matches[q], task.queries[q], options);
    matches[q].query = task.queries[q].scan;
    matches[q].which_case = which_case;
    for (int64_t& rank : matches[q].ranks) rank = task.stored[rank];
  }
  return matches;
}

}  // namespace

void check_finite(const Descriptors& descriptors) {
  check_finite(descriptors.case1, 1);
  if (descriptors.case2) check_finite(*descriptors.case2, 2);
}

Descriptors cached_or_reduced(const ReductionOptions& options, const Task& task,
                              DatasetFeatures& case1, DatasetFeatures* case2,
                              const Observer& observer, const fs::path& cache) {
  const bool learns = options.fit_on == "all" || options.fit_on == "map";
  if (cache.empty() || !learns || options.components < 0 || case1.extractor().fit_projection)
    return reduce(options, task, case1, case2, observer);
  const std::string key = descriptor_key(options, task, case1, case2);
  if (auto found = cached(options, task, cache, key, case1, case2, observer)) return *found;
  Descriptors fresh = reduce(options, task, case1, case2, observer);
  const int64_t n = case1.n();
  FeatureWriter writer(descriptor_file(cache, key, options.components),
                       str(key, "\n", options.components), case2 ? 2 * n : n, fresh.case1.d);
  write_rows(writer, fresh.case1, 0);
  if (case2) write_rows(writer, *fresh.case2, n);
  writer.finish();
  return fresh;
}

Descriptors reduce(const ReductionOptions& options, const Task& task, DatasetFeatures& case1,
                   DatasetFeatures* case2, const Observer& observer, const fs::path& model_folder) {
  const FeatureExtractor& extractor = case1.extractor();
  if (extractor.fit_projection) {
    const std::vector<int64_t> rows =
        training_rows(options, task, case1.n(), skipped_rows(case1, case2));
    const FeatureFile& features = case1.file();
    const Projection basis = extractor.fit_projection(features.rows(), rows);
    Descriptors result;
    result.of_more = [basis](const FeatureFile& more) {
      FloatMatrix descriptors(more.n(), basis.dim);
      for (int64_t i = 0; i < more.n(); ++i) basis.describe(more.row(i), descriptors.row(i));
      return descriptors;
    };
    result.case1 = result.of_more(features);
    clear_rows(result.case1, case1.skipped());
    result.comparison = basis.comparison;
    result.pca_fit = fit_text(options, static_cast<int64_t>(rows.size()), result.case1.d);
    return checked(std::move(result));
  }
  if (options.components < 0) {
    Descriptors whole;
    whole.comparison = extractor.comparison;
    whole.pca_fit = "none";
    whole.of_more = [gb = options.memory_gb](const FeatureFile& more) {
      return all_rows(more, gb);
    };
    whole.case1 = whole.of_more(case1.file());
    if (case2) whole.case2 = all_rows(case2->file(), options.memory_gb);
    return checked(std::move(whole));
  }
  const int64_t n = case1.n();
  const std::vector<int64_t> skipped = skipped_rows(case1, case2);
  FeatureFiles files{&case1.file()};
  if (case2) files.push_back(&case2->file());

  PcaOptions pca;
  pca.components = options.components ? options.components : n;
  pca.memory = static_cast<int64_t>(options.memory_gb * 1e9);
  pca.threads = options.threads;
  pca.progress = observer.stage("reducing", "columns");
  pca.stop = observer.stop;
  pca.model_folder = model_folder;

  Descriptors result;
  result.comparison = extractor.comparison;
  FloatMatrix all;
  if (options.fit_on == "all" || options.fit_on == "map") {
    pca.fit_rows = training_rows(options, task, n, skipped);
    PcaResult fitted = fit_pca(files, pca);
    result.pca_fit = fit_text(options, static_cast<int64_t>(pca.fit_rows.size()), fitted.rank);
    result.note = fitted.note;
    all = std::move(fitted.descriptors);
  } else {
    all = PcaModel(options.fit_on).project(files, pca);
    result.pca_fit = str(options.fit_on, ": ", all.d, " components");
    pca.model_folder = options.fit_on;
  }
  if (!pca.model_folder.empty())
    result.of_more = [pca, numbers = all.d](const FeatureFile& more) {
      PcaOptions quiet = pca;
      quiet.progress = {};
      quiet.components = numbers;
      return PcaModel(pca.model_folder).project({&more}, quiet);
    };
  result.case1 = rows_of(all, 0, n);
  clear_rows(result.case1, skipped);
  if (case2) {
    result.case2 = rows_of(all, n, n);
    clear_rows(*result.case2, skipped);
  }
  return checked(std::move(result));
}

std::vector<Match> retrieve(const Descriptors& descriptors, const Task& task,
                            const SearchOptions& options, QueryCase query_case) {
  check(descriptors, task, query_case);
  PlaceIndex index(descriptors.case1.d, descriptors.comparison);
  for (const int64_t row : task.stored) index.add_view(descriptors.case1.row(row));
  if (query_case == QueryCase::kTwo) return search(index, *descriptors.case2, 2, task, options);
  if (query_case == QueryCase::kAsStored) return search(index, descriptors.case1, 1, task, options);

  SearchOptions half = options;
  int64_t before = 0;
  if (options.progress)
    half.progress = [&](int64_t done, int64_t n) { options.progress(before + done, 2 * n); };
  std::vector<Match> matches = search(index, descriptors.case1, 1, task, half);
  before = static_cast<int64_t>(matches.size());
  std::vector<Match> turned = search(index, *descriptors.case2, 2, task, half);
  for (size_t q = 0; q < matches.size(); ++q)
    if (turned[q].score > matches[q].score) matches[q] = std::move(turned[q]);
  return matches;
}

}  // namespace revisit
