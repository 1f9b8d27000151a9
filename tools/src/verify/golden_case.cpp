#include "golden_case.h"

#include <google/protobuf/struct.pb.h>

#include <algorithm>

#include "cli/json.h"
#include "revisit/base/error.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;
using google::protobuf::Struct;
using google::protobuf::Value;

std::vector<fs::path> entries(const fs::path& folder) {
  std::vector<fs::path> result;
  for (const auto& entry : fs::directory_iterator(folder)) result.push_back(entry.path());
  std::sort(result.begin(), result.end());
  return result;
}

/// Part of a file name between `prefix` and ".npy"; absent for another name.
std::optional<std::string> npy_name(const fs::path& file, const std::string& prefix) {
  const std::string name = file.filename().string();
  if (!name.starts_with(prefix) || !name.ends_with(".npy")) return std::nullopt;
  return name.substr(prefix.size(), name.size() - prefix.size() - 4);
}

void add_arrays(const fs::path& folder, GoldenCase* golden) {
  for (const fs::path& file : entries(folder)) {
    if (file.filename() == "in.npy") golden->inputs[""] = file;
    if (const auto blob = npy_name(file, "in_")) golden->inputs[*blob] = file;
    if (const auto output = npy_name(file, "out_")) golden->outputs[*output] = file;
  }
}

std::optional<fs::path> first_that_exists(const fs::path& folder,
                                          std::initializer_list<const char*> names) {
  for (const char* name : names)
    if (fs::exists(folder / name)) return folder / name;
  return std::nullopt;
}

const Value* find(const Struct& object, const std::string& key) {
  const auto found = object.fields().find(key);
  return found == object.fields().end() ? nullptr : &found->second;
}

std::string text(const Struct& object, const std::string& key) {
  const Value* value = find(object, key);
  return value ? value->string_value() : "";
}

double real(const Struct& object, const std::string& key) {
  const Value* value = find(object, key);
  return value ? value->number_value() : 0;
}

std::vector<float> reals(const Struct& object, const std::string& key) {
  std::vector<float> result;
  if (const Value* value = find(object, key))
    for (const Value& item : value->list_value().values())
      result.push_back(static_cast<float>(item.number_value()));
  return result;
}

std::vector<GoldenLayer> layers_of(const fs::path& folder, const Struct& manifest) {
  std::vector<GoldenLayer> layers;
  const Value* list = find(manifest, "layers");
  if (!list) return layers;
  for (const Value& value : list->list_value().values()) {
    const Struct& entry = value.struct_value();
    GoldenLayer layer;
    layer.layer = text(entry, "layer");
    layer.type = text(entry, "type");
    layer.index = static_cast<int>(real(entry, "index"));
    layer.port = !layers.empty() && layers.back().index == layer.index ? layers.back().port + 1 : 0;
    layer.absmax = real(entry, "absmax");
    layer.rms = real(entry, "rms");
    layer.first = reals(entry, "first");
    layer.last = reals(entry, "last");
    if (!text(entry, "file").empty()) layer.file = folder / text(entry, "file");
    layers.push_back(std::move(layer));
  }
  return layers;
}

/// Inputs are named by size.
void add_variants(const fs::path& folder, const Struct& manifest, const fs::path& weights,
                  std::vector<GoldenCase>* cases) {
  const fs::path layer_input = folder / text(manifest, "all_layers_input");
  for (const fs::path& prototxt : entries(folder)) {
    if (prototxt.extension() != ".prototxt") continue;
    std::string variant = prototxt.stem().string();
    const bool is_v1 = variant.ends_with("_v1");
    if (is_v1) variant.resize(variant.size() - 3);
    for (const fs::path& file : entries(folder)) {
      const auto size = npy_name(file, "out_" + variant + "_");
      if (!size) continue;
      GoldenCase golden{prototxt.filename().string() + " " + *size, prototxt, weights};
      golden.inputs[""] = layer_input.parent_path() / ("in_1x3x" + *size + ".npy");
      golden.outputs[""] = file;
      if (!is_v1 && variant == "pool5" && golden.inputs[""].filename() == layer_input.filename())
        golden.layers = layers_of(folder, manifest);
      cases->push_back(std::move(golden));
    }
  }
}

void add_manifest_cases(const fs::path& folder, std::vector<GoldenCase>* cases) {
  const Struct manifest = read_json(folder / "manifest.json");
  const std::string weights = text(manifest, "weights");
  const fs::path weights_file = folder / (weights.empty() ? "weights.caffemodel" : weights);
  if (find(manifest, "all_layers_input")) {
    add_variants(folder, manifest, weights_file, cases);
    return;
  }
  GoldenCase golden{"", folder / "deploy.prototxt", weights_file};
  golden.layers = layers_of(folder, manifest);
  add_arrays(folder, &golden);
  golden.inputs[""] = folder / text(manifest, "input");
  for (const fs::path& file :
       fs::exists(folder / "layers") ? entries(folder / "layers") : std::vector<fs::path>{}) {
    const std::string stem = file.stem().string();  // 031_pool5.0: index, layer, output
    for (GoldenLayer& layer : golden.layers)
      if (layer.index == std::atoi(stem.c_str()) &&
          stem.ends_with("." + std::to_string(layer.port)))
        layer.file = file;
  }
  cases->push_back(std::move(golden));
}

void add_index_cases(const fs::path& folder, std::vector<GoldenCase>* cases) {
  const Struct index = read_json(folder / "index.json");
  const Value* list = find(index, "");
  if (!list) return;
  for (const Value& value : list->list_value().values()) {
    const Struct& pair = value.struct_value();
    if (text(pair, "prototxt").empty() || text(pair, "weights").empty()) continue;
    GoldenCase golden{text(pair, "prototxt") + " " + text(pair, "weights"),
                      folder / text(pair, "prototxt"), folder / text(pair, "weights")};
    add_arrays(folder, &golden);
    cases->push_back(std::move(golden));
  }
}

void add_plain_cases(const fs::path& folder, const fs::path& prototxt,
                     std::vector<GoldenCase>* cases) {
  const auto weights = first_that_exists(folder, {"weights.caffemodel", "weights.caffemodel.h5"});
  GoldenCase golden{"", prototxt, weights};
  add_arrays(folder, &golden);
  if (!golden.outputs.empty()) cases->push_back(std::move(golden));
  for (const fs::path& sub : entries(folder)) {
    if (!fs::is_directory(sub) || !fs::exists(sub / "in.npy")) continue;
    GoldenCase size{sub.filename().string(), prototxt, weights};
    add_arrays(sub, &size);
    cases->push_back(std::move(size));
  }
}

/// Decides whether index.json is a case, because it may also list sub-folders.
bool has_inputs(const fs::path& folder) {
  return std::ranges::any_of(entries(folder), [](const fs::path& file) {
    return file.filename() == "in.npy" || npy_name(file, "in_");
  });
}

void search(const fs::path& folder, std::vector<GoldenCase>* cases) {
  const size_t before = cases->size();
  if (fs::exists(folder / "manifest.json")) {
    add_manifest_cases(folder, cases);
  } else if (const auto prototxt = first_that_exists(folder, {"net.prototxt", "deploy.prototxt"})) {
    add_plain_cases(folder, *prototxt, cases);
  } else if (fs::exists(folder / "index.json") && has_inputs(folder)) {
    add_index_cases(folder, cases);
  }
  for (size_t i = before; i < cases->size(); ++i) {
    std::string& name = (*cases)[i].name;
    name = folder.filename().string() + (name.empty() ? "" : ": " + name);
  }
  if (cases->size() > before) return;
  for (const fs::path& entry : entries(folder))
    if (fs::is_directory(entry)) search(entry, cases);
}

}  // namespace

std::vector<GoldenCase> find_golden_cases(const fs::path& folder) {
  if (!fs::is_directory(folder)) throw InputError(folder.string() + ": no such folder");
  std::vector<GoldenCase> cases;
  try {
    search(fs::canonical(folder), &cases);
  } catch (const fs::filesystem_error& error) {
    throw InputError(error.what());
  }
  if (cases.empty())
    throw InputError(folder.string() +
                     ": no case found (expected net.prototxt or deploy.prototxt with in.npy and "
                     "out_NAME.npy, or a manifest.json or index.json)");
  return cases;
}

}  // namespace revisit::cli
