#include <algorithm>
#include <cctype>

#include "cli/net_options.h"
#include "cli/terminal.h"
#include "models/models.h"
#include "revisit/engine/net.h"
#include "revisit/proto/net_file.h"

namespace revisit::models {
namespace {

namespace fs = std::filesystem;

std::string without_ending(const fs::path& file, std::initializer_list<const char*> endings) {
  std::string name = file.filename().string();
  for (const char* ending : endings)
    if (name.ends_with(ending)) name.erase(name.size() - std::string(ending).size());
  return name;
}

fs::path folder_of(const fs::path& file) {
  return file.has_parent_path() ? file.parent_path() : fs::path(".");
}

void need_file(const fs::path& file, const char* option) {
  std::error_code none;
  if (!fs::exists(file, none)) throw InputError(file.string(), ": no such file (", option, ")");
  if (fs::is_directory(file, none))
    throw InputError(file.string(), ": expected a file, found a folder (", option, ")");
}

fs::path prototxt_beside(const fs::path& weights) {
  const fs::path folder = folder_of(weights);
  const std::string stem = without_ending(weights, {".h5", ".caffemodel"});
  for (const std::string& name :
       {stem + ".prototxt", stem + "_deploy.prototxt", std::string("deploy.prototxt")})
    if (fs::is_regular_file(folder / name)) return folder / name;
  const std::vector<fs::path> all = files_in(folder, {".prototxt"});
  return all.size() == 1 ? all[0] : fs::path();
}

/// Weights with the name `stem`, or the only ones. Throws UsageError if that is ambiguous.
fs::path choose_weights(const fs::path& folder, const std::string& stem) {
  const auto all = files_in(folder, kWeights);
  for (const fs::path& file : all)
    if (without_ending(file, {".h5", ".caffemodel"}) == stem) return file;
  if (all.size() == 1) return all[0];
  throw UsageError(folder.string(), ": holds ", all.empty() ? "no" : "several",
                   " .caffemodel files; give one with --weights FILE");
}

bool has_layers(const caffe::NetParameter& net, const std::string& cut) {
  const auto [end, graft] = cli::parse_cut(cut);
  const auto has = [&net](const std::string& name) {
    return name.empty() || std::ranges::count(net.layer(), name, &caffe::LayerParameter::name);
  };
  return has(end) && has(graft);
}

/// Known model with the name of a network ("VGG_CNN_S"), or null.
const KnownModel* namesake(const caffe::NetParameter& net) {
  const std::string& name = net.name();
  const auto equal = [](unsigned char a, unsigned char b) { return std::tolower(a) == b; };
  for (const KnownModel& known : known_models())
    if (std::search(name.begin(), name.end(), known.name.begin(), known.name.end(), equal) !=
        name.end())
      return &known;
  return nullptr;
}

std::string choose_cut(const ModelRequest& request, const KnownModel* known,
                       const caffe::NetParameter& net, const fs::path& prototxt) {
  if (request.end.starts_with('+')) throw UsageError("graft needs end, the layer before it");
  if (!request.end.empty()) return request.end;
  if (!known) known = namesake(net);
  if (known)
    for (const std::string& cut : known->cuts)
      if (has_layers(net, cut)) return cut;
  for (const KnownModel& other : known_models())
    for (const std::string& cut : other.cuts)
      if (has_layers(net, cut)) return cut;
  throw UsageError(prototxt.string(), ": not a known network; give the layer of the feature ",
                   "with --end LAYER ('revisit net inspect' lists the layers)");
}

FoundModel complete(const ModelRequest& request, FoundModel found, const KnownModel* known) {
  if (!known) known = known_model_by_sha1(found.weights_sha1);
  if (found.prototxt.empty() && known) found.prototxt = own_prototxt(*known, cache_folder());
  if (found.prototxt.empty())
    throw UsageError(found.weights.string(), ": no prototxt found for these weights",
                     known ? " (official: " + known->prototxt_address + ")" : "",
                     "; give it with --model FILE, or put deploy.prototxt beside it");
  need_file(found.prototxt, "--model");
  const caffe::NetParameter net =
      proto::read_net(found.prototxt, {.allow_unknown_fields = true,
                                       .keep_unread = true,
                                       .types_with_weights = engine::types_with_weights()})
          .net;
  found.name = known                ? known->name
               : net.name().empty() ? found.prototxt.stem().string()
                                    : net.name();
  found.trained = !is_untrained(net.name());
  found.cut = choose_cut(request, known, net, found.prototxt);
  if (request.mean_bgr) {
    found.mean_bgr = *request.mean_bgr;
  } else if (known && known->mean_bgr) {
    found.mean_bgr = *known->mean_bgr;
  } else {
    found.mean_bgr = kIlsvrcMeanBgr;
    if (found.trained)
      found.warnings.push_back(
          str("the mean of '", found.name, "' is unknown; that of ILSVRC 2012 is subtracted"));
  }
  return found;
}

FoundModel from_files(const ModelRequest& request, const fs::path& prototxt,
                      const fs::path& weights, const KnownModel* known = nullptr) {
  need_file(weights, "--weights");
  FoundModel found;
  found.weights = weights;
  found.weights_sha1 = file_sha1(weights);
  found.prototxt = prototxt.empty() ? prototxt_beside(weights) : prototxt;
  return complete(request, found, known);
}

std::optional<FoundModel> from_cache(const ModelRequest& request, const fs::path& cache,
                                     const KnownModel& known) {
  const std::optional<fs::path> weights = cached_weights(cache, known);
  if (!weights) return std::nullopt;
  FoundModel found = from_files(request, "", *weights, &known);
  if (known.sha1_is_doubtful && found.weights_sha1 != known.sha1)
    found.warnings.push_back(str(weights->string(), ": does not have the checksum of ", known.name,
                                 " that is known (", known.sha1_source,
                                 "); it is used nevertheless"));
  else if (!known.sha1.empty() && found.weights_sha1 != known.sha1)
    throw InputError(weights->string(), ": is not the known ", known.name,
                     "; give it with --weights to use it nevertheless, or remove it: ",
                     how_to_get(known, cache), "\n  sha1 expected: ", known.sha1, " (",
                     known.sha1_source, ")\n  sha1 found:    ", found.weights_sha1);
  return found;
}

FoundModel from_cache_or_models_folder(const ModelRequest& request) {
  const fs::path cache = cache_folder();
  for (const KnownModel& known : known_models())
    if (auto found = from_cache(request, cache, known)) return *found;
  if (!files_in(cache, kWeights).empty()) return from_files(request, "", choose_weights(cache, ""));
  throw UsageError("no model: give --model PROTOTXT --weights CAFFEMODEL, fetch one ",
                   "('revisit models fetch bvlc_alexnet'; looked in ", cache.string(),
                   "), or write an untrained one for tests ",
                   "('revisit models make-random -o DIR')");
}

/// --model alone: a folder, a prototxt, or the name of a known model.
FoundModel from_model_argument(const ModelRequest& request) {
  const fs::path& model = request.model;
  if (fs::is_directory(model)) return from_files(request, "", choose_weights(model, ""));
  if (fs::exists(model))
    return from_files(
        request, model,
        choose_weights(folder_of(model), without_ending(model, {".prototxt", "_deploy"})));
  if (model.has_parent_path() || model.string().ends_with(".prototxt"))
    throw InputError(model.string(), ": no such file (--model)");
  const KnownModel& known = known_model(model.string());
  const fs::path cache = cache_folder();
  if (auto found = from_cache(request, cache, known)) return *found;
  throw UsageError("model '", known.name, "' is not in ", cache.string(), "; ",
                   how_to_get(known, cache));
}

std::vector<KnownModel>::const_iterator row_of(const FoundModel& model) {
  return std::ranges::find(known_models(), model.name, &KnownModel::name);
}

}  // namespace

FoundModel find_model(const ModelRequest& request) {
  if (!request.weights.empty()) {
    if (fs::is_directory(request.model))
      throw UsageError("--model ", request.model.string(), ": with --weights, expected a prototxt");
    return from_files(request, request.model, request.weights);
  }
  return request.model.empty() ? from_cache_or_models_folder(request)
                               : from_model_argument(request);
}

std::vector<FoundModel> all_models(const fs::path& folder) {
  if (!folder.empty() && !fs::is_directory(folder))
    throw UsageError(folder.string() + ": no such folder (--model)");
  std::vector<FoundModel> all;
  for (const fs::path& weights : files_in(folder.empty() ? cache_folder() : folder, kWeights, true))
    try {
      FoundModel found = find_model({.weights = weights});
      if (std::ranges::count(all, found.name, &FoundModel::name) == 0)
        all.push_back(std::move(found));
    } catch (const Error& unusable) {
      cli::warn(str(weights.string(), " is skipped: ", unusable.what()));
    }
  std::ranges::stable_sort(
      all, {}, [](const FoundModel& model) { return std::pair(!model.trained, row_of(model)); });
  return all;
}

std::vector<std::string> cuts_of(const FoundModel& model) {
  const auto row = row_of(model);
  return row == known_models().end() ? std::vector{model.cut} : row->cuts;
}

}  // namespace revisit::models
