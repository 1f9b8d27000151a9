#include "models/models.h"

#include <unistd.h>

#include "cli/net_options.h"
#include "revisit/proto/net_file.h"
#include "testing.h"

namespace {

using namespace revisit;
using models::CacheState;

class Environment {
 public:
  Environment(const char* name, const std::string& value) : name_(name) {
    if (const char* old = std::getenv(name)) old_ = old;
    ::setenv(name, value.c_str(), 1);
  }
  ~Environment() {
    if (old_)
      ::setenv(name_, old_->c_str(), 1);
    else
      ::unsetenv(name_);
  }
  Environment(const Environment&) = delete;
  Environment& operator=(const Environment&) = delete;

 private:
  const char* name_;
  std::optional<std::string> old_;
};

std::string some_bytes(size_t count) {
  std::string bytes(count, '\0');
  for (size_t i = 0; i < count; ++i) bytes[i] = static_cast<char>(i * i + (i >> 8));
  return bytes;
}

models::ModelFiles random_model(const fs::path& folder, const char* net) {
  return models::write_random_model(folder, {.prototxt = net});
}

/// A model "m" of 300,000 bytes with the correct checksum, and a program curl of this test.
struct Fetching : testing::Test {
  TempDir programs, server, cache;
  const Environment path{"PATH", programs.path().string() + ":" + std::getenv("PATH")};
  const std::string content = some_bytes(300'000);
  models::KnownModel model;

  Fetching() {
    write_file(server / "m", content);
    model.name = "m";
    model.address = "file://" + (server / "m").string();
    model.file = "m.caffemodel";
    model.sha1 = models::file_sha1(server / "m");
    model.sha1_source = "this test";
    curl_is(kContinue);
  }
  fs::path file() const { return cache.path() / "m" / model.file; }
  fs::path part() const { return file().string() + ".part"; }
  models::Fetched fetch() { return models::fetch_model(model, cache.path()); }
  void has_no_checksum() { model.sha1.clear(), model.sha1_source.clear(); }

  /// `script`: with $from, $to and $have, the bytes that are there; calls are counted.
  void curl_is(const std::string& script) {
    write_file(programs / "curl", "#!/bin/sh\necho \"$@\" >>'" + log().string() +
                                      "'\nwhile [ $# -gt 0 ]; do case $1 in --output) to=$2;; "
                                      "--url) from=${2#file://};; esac; shift; done\n"
                                      "have=$(stat -c %s \"$to\" 2>/dev/null || echo 0)\n" +
                                      script + "\n");
    fs::permissions(programs / "curl", fs::perms::owner_all);
  }
  fs::path log() const { return programs.path() / "log"; }
  int calls() const {
    const std::string lines = read_file(log());
    return static_cast<int>(std::ranges::count(lines, '\n'));
  }

  static constexpr const char* kContinue = "tail -c +$((have + 1)) \"$from\" >>\"$to\"";
};

TEST(Checksum, AFileThatHasNotChangedIsReadOnce) {
  const auto bytes_read = [] {
    std::ifstream io("/proc/self/io");
    std::string name;
    int64_t bytes = -1;
    io >> name >> bytes;
    return bytes;
  };
  const TempDir dir;
  constexpr int64_t kSize = 20'000'000;
  write_file(dir / "w", std::string(kSize, 'a'));
  if (bytes_read() < 0) GTEST_SKIP() << "this system does not count what is read";
  const int64_t before = bytes_read();
  const std::string sum = models::file_sha1(dir / "w");
  const int64_t once = bytes_read() - before;
  EXPECT_GE(once, kSize);
  EXPECT_LT(once, 2 * kSize);
  EXPECT_EQ(models::file_sha1(dir / "w"), sum);
  EXPECT_LT(bytes_read() - before, once + kSize / 2) << "read again";
  // Content differs; size and modification time are equal.
  const fs::file_time_type time = fs::last_write_time(dir / "w");
  ::usleep(20000);  // longer than a tick of the clock of files
  write_file(dir / "w", std::string(kSize, 'b'));
  fs::last_write_time(dir / "w", time);
  EXPECT_NE(models::file_sha1(dir / "w"), sum);
}

TEST(Checksum, IsSha1OfAFile) {
  const TempDir dir;
  write_file(dir / "abc", "abc");  // FIPS 180
  EXPECT_EQ(models::file_sha1(dir / "abc"), "a9993e364706816aba3e25717850c26c9cd0d89d");
  write_file(dir / "million", std::string(1'000'000, 'a'));
  EXPECT_EQ(models::file_sha1(dir / "million"), "34aa973cd4c4daa4f61eeb2bdbad27316534016f");
  write_file(dir / "empty", "");
  EXPECT_EQ(models::file_sha1(dir / "empty"), "da39a3ee5e6b4b0d3255bfef95601890afd80709");
  EXPECT_THROW(models::file_sha1(dir / "none"), InputError);
  EXPECT_THROW(models::file_sha1(dir.path()), InputError);
}

TEST(Cache, IsWhereTheEnvironmentSays) {
  const Environment home("HOME", "/home/x");
  for (const auto& [models, xdg, folder] : {std::tuple("", "", "/home/x/.cache/revisit/models"),
                                            {"", "/c", "/c/revisit/models"},
                                            {"/m", "/c", "/m"}}) {
    const Environment first("REVISIT_MODELS", models), second("XDG_CACHE_HOME", xdg);
    EXPECT_EQ(models::cache_folder(), folder);
  }
}

TEST_F(Fetching, ModelIsVerifiedAndFetchedOnce) {
  const models::Fetched fetched = fetch();
  EXPECT_EQ(fetched.file, file());
  EXPECT_TRUE(fetched.verified);
  EXPECT_FALSE(fetched.was_there);
  EXPECT_TRUE(read_file(file()) == content);
  EXPECT_FALSE(fs::exists(part()));
  EXPECT_EQ(models::inspect(cache.path(), model).state, CacheState::kVerified);
  EXPECT_TRUE(fetch().was_there);
  EXPECT_EQ(calls(), 1);
  EXPECT_HAS(read_file(log()), "--continue-at - ");
}

TEST_F(Fetching, ResumesAPartAndTakesACompleteOneWithoutCurl) {
  for (const size_t bytes : {size_t{100'000}, content.size()}) {
    write_file(part(), content.substr(0, bytes));
    EXPECT_EQ(models::inspect(cache.path(), model).state, CacheState::kPartial);
    EXPECT_TRUE(fetch().verified);
    EXPECT_TRUE(read_file(file()) == content);
    EXPECT_EQ(calls(), 1);
    fs::remove(file());
  }
}

TEST_F(Fetching, RestartsIfAPartCannotBeResumedOrIsOfAnotherFile) {
  for (const char* script : {"[ $have = 0 ] || exit 33", "[ $have = 0 ] || exit 22", ""}) {
    curl_is(std::string(script) + "\n" + kContinue);
    write_file(part(), std::string(100'000, 'x'));
    fetch();
    EXPECT_TRUE(read_file(file()) == content) << script;
    fs::remove(file());
  }
  EXPECT_EQ(calls(), 6);
}

TEST_F(Fetching, AFailureKeepsThePartWithAdvice) {
  curl_is("head -c 1000 \"$from\" >\"$to\"; exit 18");
  expect_error<Error>([&] { fetch(); }, {"cannot fetch m: curl failed with exit code 18",
                                         model.address, file().string()});
  EXPECT_EQ(fs::file_size(part()), 1000U);
  EXPECT_FALSE(fs::exists(file()));
}

TEST_F(Fetching, AFileWithAnotherChecksumIsRemoved) {
  const std::string found = model.sha1;
  model.sha1 = std::string(40, 'a');
  expect_error<Error>([&] { fetch(); }, {model.sha1, found});
  EXPECT_TRUE(fs::is_empty(cache.path() / "m"));
  // A file of the user stays.
  write_file(file(), "something else");
  EXPECT_EQ(models::inspect(cache.path(), model).state, CacheState::kIncorrect);
  EXPECT_HAS(message_of<Error>([&] { fetch(); }), "not the known file");
  EXPECT_EQ(read_file(file()), "something else");
}

TEST_F(Fetching, WithoutChecksumAWebPageIsNoModel) {
  has_no_checksum();
  for (const char* name : {"m.caffemodel", "m.tar.gz"})
    for (const char* page : {"<html>please log in</html>", ""}) {
      model.file = name;
      write_file(server / "m", page);
      EXPECT_HAS(message_of<Error>([&] { fetch(); }), "is not the model");
      EXPECT_TRUE(fs::is_empty(cache.path() / "m"));
    }
  write_file(server / "m", "\x1f\x8b\x08 archive");
  EXPECT_FALSE(fetch().verified);
}

TEST_F(Fetching, WithoutAReliableChecksumNothingIsRemovedOrMixed) {
  fs::rename(random_model(server.path(), "ring16").weights, server / "m");
  for (const bool doubtful : {true, false}) {
    if (!doubtful) has_no_checksum();
    model.sha1_is_doubtful = doubtful;
    write_file(part(), "old beginning");
    const models::Fetched fetched = fetch();
    EXPECT_FALSE(fetched.verified);
    EXPECT_EQ(fetched.sha1, models::file_sha1(server / "m"));
    EXPECT_EQ(models::inspect(cache.path(), model).state, CacheState::kUnverified);
    fs::remove(file());
  }
}

TEST_F(Fetching, ALinkInPlaceOfThePartIsNotFollowed) {
  write_file(server / "victim", "precious");
  fs::create_directories(part().parent_path());
  fs::create_symlink(server / "victim", part());
  EXPECT_HAS(message_of<Error>([&] { fetch(); }), "symbolic link");
  EXPECT_EQ(read_file(server / "victim"), "precious");
}

TEST_F(Fetching, AnInterruptEndsCurlAndKeepsThePart) {
  curl_is("echo beginning >\"$to\"; exec sleep 60");
  const auto result =
      run_revisit("models fetch bvlc_alexnet",
                  "REVISIT_MODELS='" + cache.path().string() + "' timeout --foreground -s INT 2");
  EXPECT_HAS(result.err, "interrupted");
  EXPECT_EQ(read_file(cache / "bvlc_alexnet/bvlc_alexnet.caffemodel.part"), "beginning\n");
}

TEST_F(Fetching, WritesOurPrototxtButKeepsTheUsers) {
  model.own_net = "alexnet";
  const fs::path prototxt = fetch().prototxt;
  EXPECT_EQ(prototxt, cache.path() / "m" / "deploy.prototxt");
  EXPECT_EQ(read_file(prototxt), models::own_net("alexnet"));
  write_file(prototxt, "# mine");
  fetch();
  EXPECT_EQ(read_file(prototxt), "# mine");
}

struct Finding : testing::Test {
  TempDir cache, own;
  const Environment models_variable{"REVISIT_MODELS", cache.path().string()};
  models::ModelFiles random() { return random_model(own.path(), "alexnet"); }
  static void expect_refused(const models::ModelRequest& request,
                             std::initializer_list<std::string> parts) {
    expect_error<Error>([&] { models::find_model(request); }, parts);
  }
};

TEST_F(Finding, WithoutAModelThereIsAdvice) {
  expect_refused({}, {"models fetch", "make-random", cache.path().string()});
}

TEST_F(Finding, BothFilesAsGiven) {
  const auto files = random();
  models::ModelRequest request{.model = files.prototxt, .weights = files.weights};
  const models::FoundModel found = models::find_model(request);
  EXPECT_EQ(found.prototxt, files.prototxt);
  EXPECT_EQ(found.weights, files.weights);
  EXPECT_FALSE(found.trained);
  EXPECT_EQ(found.cut, "conv3+pool5");
  EXPECT_EQ(found.mean_bgr, models::kIlsvrcMeanBgr);

  request.end = "conv4";
  request.mean_bgr = {1, 2, 3};
  EXPECT_EQ(models::find_model(request).cut, "conv4");
  EXPECT_EQ(models::find_model(request).mean_bgr[2], 3);
}

TEST_F(Finding, OtherWeightsOfAKnownNetworkHaveItsBestLayer) {
  // Simulates fine-tuned weights: unknown checksum, known name in the prototxt.
  const auto best = [&](const std::string& net) {
    return models::find_model({.weights = random_model(own.path(), net.c_str()).weights}).cut;
  };
  EXPECT_EQ(best("alexnet"), "conv3+pool5");
  EXPECT_EQ(best("vgg_cnn_s"), "conv4+pool5");
  EXPECT_EQ(best("places_cnds8"), "pool5");
}

TEST_F(Finding, WeightsWithoutTheDoubtfulChecksumAreUsedWithAWarning) {
  const auto made = random_model(own.path(), "vgg_cnn_s");
  fs::create_directories(cache / "vgg_cnn_s");
  fs::copy_file(made.weights, cache.path() / "vgg_cnn_s" / "VGG_CNN_S.caffemodel");
  const models::FoundModel found = models::find_model({.model = "vgg_cnn_s"});
  EXPECT_EQ(found.cut, "conv4+pool5");
  ASSERT_EQ(found.warnings.size(), 1U);
  EXPECT_HAS(found.warnings[0], "third-party");
}

TEST_F(Finding, TheOtherFileIsLookedForBeside) {
  const auto files = random();
  EXPECT_EQ(models::find_model({.weights = files.weights}).prototxt, files.prototxt);
  EXPECT_EQ(models::find_model({.model = files.prototxt}).weights, files.weights);
  EXPECT_EQ(models::find_model({.model = own.path()}).weights, files.weights);

  const fs::path other = own / "other.caffemodel";
  fs::copy_file(files.prototxt, own / "deploy.prototxt");
  fs::copy_file(files.weights, other);
  expect_refused({.model = own.path()}, {"several"});
  EXPECT_EQ(models::find_model({.weights = other}).prototxt, own / "deploy.prototxt");
  EXPECT_EQ(models::find_model({.weights = files.weights}).prototxt, files.prototxt)
      << "its own name comes first";
}

TEST_F(Finding, MissingFilesAreNamed) {
  expect_refused({.weights = own / "none.caffemodel"}, {"none.caffemodel"});
  expect_refused({.model = own / "none.prototxt"}, {"none.prototxt"});
  expect_refused({.model = "bvlc_alexnet"}, {"models fetch bvlc_alexnet"});
  expect_refused({.model = "bvlc_alexnett"}, {"did you mean 'bvlc_alexnet'"});
  expect_refused({.weights = random().weights, .end = "+pool5"}, {"graft needs end"});
}

TEST_F(Finding, CachedModelWithoutChecksumUsesOurDescription) {
  fs::create_directories(cache / "places_cnds8");
  const auto cnds = random_model(own.path(), "places_cnds8");
  fs::copy_file(cnds.weights, cache.path() / "places_cnds8" / "8conv3fc_CNDS.caffemodel");
  const models::FoundModel found = models::find_model({});
  EXPECT_EQ(found.name, "places_cnds8");
  EXPECT_EQ(found.prototxt, cache.path() / "places_cnds8" / "deploy.prototxt");
  EXPECT_TRUE(found.trained);
  EXPECT_EQ(found.cut, "pool5");
  ASSERT_EQ(found.warnings.size(), 1U);  // its mean is unknown
  EXPECT_HAS(found.warnings[0], "mean");
}

TEST_F(Finding, CachedModelWithAWrongChecksumIsRefused) {
  const auto files = random();
  fs::create_directories(cache / "bvlc_alexnet");
  fs::copy_file(files.weights, cache.path() / "bvlc_alexnet" / "bvlc_alexnet.caffemodel");
  expect_refused({}, {"9116a64c0fbe4459d18f4bb6b56d647b63920377"});
}

TEST_F(Finding, ModelsFolderOfOneModelOrMany) {
  REVISIT_NEED_SHARED(all, "data/caffemodels");
  const fs::path squeezenet = all / "squeezenet_v1.0";
  for (const fs::path& folder : {squeezenet, all}) {
    const Environment variable("REVISIT_MODELS", folder.string());
    const models::FoundModel found = models::find_model({});
    EXPECT_EQ(found.name, "squeezenet_v1.0");
    EXPECT_EQ(found.weights, squeezenet / "weights.caffemodel");
    EXPECT_EQ(found.prototxt, squeezenet / "deploy.prototxt");
    EXPECT_TRUE(found.trained);
    EXPECT_EQ(found.cut, "pool8");
    EXPECT_EQ(found.mean_bgr, (std::array<double, 3>{104, 117, 123}));
  }
}

TEST_F(Finding, ListsModelsInUse) {
  models::KnownModel model;
  model.name = "m";
  model.file = "m.caffemodel";
  EXPECT_EQ(models::inspect(cache.path(), model).state, CacheState::kAbsent);
  // Weights in the cache folder itself, as when it is the folder of one model.
  write_file(cache / "weights.caffemodel", "weights");
  model.sha1 = models::file_sha1(cache / "weights.caffemodel");
  const auto loose = models::loose_weights(cache.path());
  EXPECT_EQ(models::inspect(cache.path(), model, loose).state, CacheState::kVerified);
  EXPECT_EQ(models::inspect(cache.path(), model, loose).file, cache / "weights.caffemodel");
  // Weights in the model's folder, under another name.
  write_file(cache / "m/renamed.caffemodel", "weights");
  EXPECT_EQ(models::inspect(cache.path(), model).state, CacheState::kVerified);
  EXPECT_EQ(models::inspect(cache.path(), model).file, cache / "m/renamed.caffemodel");
}

TEST_F(Finding, ModelsWithoutAddressAreNotAdvised) {
  for (const auto& [model, part] :
       {std::pair("squeezenet_v1.0",
                  (cache / "squeezenet_v1.0/squeezenet_v1.0.caffemodel").string()),
        {"places_cnds8", "https://drive.google.com/"}}) {
    const std::string advice = message_of<Error>([&] { models::find_model({.model = model}); });
    EXPECT_EQ(advice.find("models fetch"), std::string::npos) << advice;
    EXPECT_HAS(advice, part);
  }
}

TEST(ModelsCommand, MakesRandomNetworks) {
  const TempDir dir;
  expect_exit(0, {"untrained"}, "models make-random --seed 5 -o '" + (dir / "r").string() + "'");
  EXPECT_TRUE(fs::exists(dir.path() / "r" / "alexnet_random.prototxt"));
  EXPECT_TRUE(fs::exists(dir.path() / "r" / "alexnet_random.caffemodel"));
  EXPECT_EQ(run_revisit("models make-random").exit_code, 2);
  EXPECT_EQ(
      run_revisit("models make-random --net lenet -o '" + dir.path().string() + "'").exit_code, 2);
  EXPECT_EQ(run_revisit("models make-random -o /proc/nowhere").exit_code, 1);
}

TEST(ModelsCommand, MakesRandomWeightsOfAnyPrototxt) {
  const TempDir dir;
  write_file(
      dir / "train_val.prototxt",
      "name: 'it' layer { name: 'd' type: 'Data' top: 'data' top: 'label' data_param { batch_size: "
      "1 } } layer { name: 'conv' type: 'Convolution' bottom: 'data' top: 'conv' param { name: 'w' "
      "} convolution_param { num_output: 64 kernel_size: 5 bias_term: false } } layer { name: 'bn' "
      "type: 'BatchNorm' bottom: 'conv' top: 'conv' } layer { name: 'scale' type: 'Scale' bottom: "
      "'conv' top: 'conv' scale_param { bias_term: true } } layer { name: 'again' type: "
      "'Convolution' bottom: 'data' top: 'again' param { name: 'w' } convolution_param { "
      "num_output: 64 kernel_size: 5 bias_term: false } } layer { name: 'sum' type: 'Eltwise' "
      "bottom: 'conv' bottom: 'again' top: 'sum' } layer { name: 'loss' type: 'SoftmaxWithLoss' "
      "bottom: 'sum' bottom: 'label' }");
  const std::string file = (dir / "train_val.prototxt").string(), r = (dir / "r").string();
  const auto make = [&](const std::string& options) {
    return run_revisit("models make-random -o '" + r + "' --net '" + file + "' " + options);
  };
  const auto made = make("--input-shape 1,3,9,9 --seed 5");
  ASSERT_EQ(made.exit_code, 0) << made.err;
  EXPECT_HAS(made.err, "untrained: random weights (seed 5)");
  const std::string pair = r + "/train_val_random.prototxt " + r + "/train_val_random.caffemodel";
  const std::string first = read_file(dir / "r/train_val_random.caffemodel");
  run_ok("net inspect " + pair);
  EXPECT_TRUE(
      models::is_untrained(proto::read_net(dir / "r/train_val_random.prototxt").net.name()));

  const caffe::NetParameter net = proto::read_net_binary(dir / "r/train_val_random.caffemodel").net;
  const auto blob = [&](const std::string& name, int i) -> const caffe::BlobProto& {
    return std::ranges::find(net.layer(), name, &caffe::LayerParameter::name)->blobs(i);
  };
  double squares = 0;
  for (const float value : blob("conv", 0).data()) squares += value * value;
  EXPECT_NEAR(squares / (64 * 75) * 75, 2, 0.1) << "the variance of He";
  EXPECT_EQ(blob("conv", 0).SerializeAsString(), blob("again", 0).SerializeAsString()) << "shared";
  for (const float value : blob("scale", 0).data()) EXPECT_NEAR(value, 1, 0.11);

  make("--input-shape 1,3,9,9 --seed 5");
  EXPECT_EQ(read_file(dir / "r/train_val_random.caffemodel"), first);
  make("--input-shape 1,3,9,9 --seed 6");
  EXPECT_NE(read_file(dir / "r/train_val_random.caffemodel"), first);

  const auto refused = [&](int code, const std::string& what, const std::string& options) {
    expect_exit(code, {what}, "models make-random -o '" + r + "' " + options);
  };
  refused(3, "no shape for the input 'data'; give it in the prototxt or by an input shape",
          "--net '" + file + "'");
  refused(3, "none.prototxt: cannot open", "--net " + r + "/none.prototxt");
  refused(2, "did you mean 'alexnet'?", "--net alexnt");
  refused(2, "has no layer or blob 'conv'", "--end conv");
}

TEST(ModelsCommand, EndTruncatesAnyPrototxt) {
  const TempDir dir;
  const std::string r = (dir / "r").string();
  const auto layers = [&](const std::string& net, const std::string& options) {
    run_ok("models make-random --net '" + net + "' -o '" + r + "' " + options);
    const std::string stem = r + "/" + fs::path(net).stem().string() + "_random";
    run_ok("net inspect " + stem + ".prototxt " + stem + ".caffemodel");
    std::string names;
    const caffe::NetParameter written = proto::read_net_binary(stem + ".caffemodel").net;
    for (const auto& layer : written.layer()) names += layer.name() + " ";
    return names;
  };
  EXPECT_EQ(layers("ring16", ""), "data conv1 relu1 pool1 ");
  EXPECT_EQ(layers("ring16", "--end relu1 --input-shape 1x1x16x2560"), "data conv1 relu1 ");
  EXPECT_EQ(layers(r + "/ring16_random.prototxt", "--end conv1"), "data conv1 ");
  const auto weights = [&](const std::string& name) {
    return proto::read_net_binary(r + name).net.layer(1).blobs(0).SerializeAsString();
  };
  EXPECT_EQ(weights("/ring16_random_random.caffemodel"), weights("/ring16_random.caffemodel"));
}

TEST(ModelsCommand, RandomWeightsTakeThePlaceOfThePrototxts) {
  const TempDir dir;
  const std::string r = (dir / "r").string(), input = "input: 'd' input_shape { dim: [1, 40000] }",
                    inner =
                        "layer { name: 'a' type: 'InnerProduct' bottom: 'd' "
                        "inner_product_param { bias_term: false num_output: ";
  const auto make = [&](const std::string& layers) {
    write_file(dir / "net.prototxt", input + layers);
    return "models make-random -o '" + r + "' --net '" + (dir / "net.prototxt").string() + "'";
  };
  std::string own = "blobs { shape { dim: 1 dim: 40000 } ";
  for (int i = 0; i < 40'000; ++i) own += "data: 7 ";
  run_ok(make(inner + "1 } top: 'a' " + own + "} }"));
  run_ok("net inspect " + r + "/net_random.prototxt " + r + "/net_random.caffemodel");
  const caffe::NetParameter net = proto::read_net_binary(dir / "r/net_random.caffemodel").net;
  EXPECT_LT(net.layer(1).blobs(0).data(0), 7);

  expect_exit(3, {"its weights take 3200000000 bytes (a caffemodel holds at most 2^31-1)"},
              make(inner + "20000 } top: 'a' }"));
  expect_exit(3, {"layer 'a' (InnerProduct) has weights and the name of an earlier layer"},
              make(inner + "1 } top: 'a' }" + inner + "1 } top: 'b' }"));
}

TEST(ModelsCommand, ListsTheKnownModelsAndTheFilesOfOne) {
  const TempDir cache, own;
  const std::string environment = "REVISIT_MODELS='" + cache.path().string() + "'";
  const auto known = run_ok("models list", environment);
  for (const char* part : {"bvlc_alexnet", "absent", "no network for commands without --model"})
    EXPECT_HAS(known.out, part);
  EXPECT_EQ(run_revisit("models lst", environment).exit_code, 2);
  EXPECT_EQ(run_revisit("models list bvlc_alexnet", environment).exit_code, 2);
  const auto files = random_model(own.path(), "vgg_cnn_s");
  for (const fs::path& model : {own.path(), files.prototxt, files.weights}) {
    const auto found = run_ok("models list '" + model.string() + "'", environment);
    EXPECT_HAS(found.out, files.weights.string());
    EXPECT_HAS(found.out, "UNTRAINED");
    EXPECT_HAS(found.out, "conv4+pool5");
  }
  fs::copy(own.path(), cache.path(), fs::copy_options::recursive);
  EXPECT_HAS(run_revisit("models list", environment).out,
             "weights:   " + (cache / files.weights.filename()).string());
}

TEST(ModelsCommand, FetchFailuresAreOneClearMessage) {
  const TempDir cache;
  const std::string environment = "REVISIT_MODELS='" + cache.path().string() + "' ";
  const auto without_curl =
      run_revisit("models fetch bvlc_alexnet", environment + "PATH=" + cache.path().string());
  EXPECT_EQ(without_curl.exit_code, 1);
  EXPECT_HAS(without_curl.err, "curl is not installed (Debian: apt install curl)");
  EXPECT_EQ(without_curl.out, "");
  expect_exit(1, {"browser"}, "models fetch places_cnds8", environment);
  EXPECT_EQ(run_revisit("models fetch squeezenet_v1.0", environment).exit_code, 1);
  EXPECT_EQ(run_revisit("models fetch nonsense", environment).exit_code, 2);
  EXPECT_EQ(run_revisit("models fetch", environment).exit_code, 2);
}

}  // namespace
