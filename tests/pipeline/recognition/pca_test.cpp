#include <Eigen/Eigenvalues>

#include "revisit/proto/npy.h"
#include "revisit/recognition/feature_file.h"
#include "testing.h"

namespace revisit {
namespace {

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Rows off the origin; variances differ clearly, so that directions are well determined.
Matrix random_features(int64_t n, int64_t d, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Matrix spread = Matrix::NullaryExpr(d, d, [&] { return normal(random) / std::sqrt(d); });
  Matrix x = Matrix::NullaryExpr(n, d, [&] { return normal(random); });
  for (int64_t j = 0; j < d; ++j) x.col(j) *= 10 * std::pow(0.85, j);
  x = x * spread;
  x.rowwise() += Eigen::RowVectorXd::LinSpaced(d, 1, 7);
  return x.cast<float>().cast<double>();
}

FeatureFile stored(const TempDir& dir, const std::string& name, const Matrix& x) {
  FeatureWriter writer(dir / name, "test", x.rows(), x.cols());
  for (int64_t i = 0; i < x.rows(); ++i) {
    const Eigen::RowVectorXf row = x.row(i).cast<float>();
    writer.append({row.data(), static_cast<size_t>(row.size())});
  }
  writer.finish();
  return FeatureFile(dir / name);
}

Matrix centered(const Matrix& x, const std::vector<int64_t>& fit) {
  Eigen::RowVectorXd mean = Eigen::RowVectorXd::Zero(x.cols());
  for (const int64_t row : fit) mean += x.row(row) / static_cast<double>(fit.size());
  return x.rowwise() - mean;
}

/// Reference: eigenvectors of the covariance matrix of the fitted rows.
struct Textbook {
  Eigen::VectorXd variances;  // largest first
  Matrix descriptors;         // of all rows
};
Textbook textbook(const Matrix& x, const std::vector<int64_t>& fit, int64_t k) {
  const Matrix c = centered(x, fit);
  Matrix covariance = Matrix::Zero(x.cols(), x.cols());
  for (const int64_t row : fit)
    covariance += c.row(row).transpose() * c.row(row) / (static_cast<double>(fit.size()) - 1);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(covariance);
  return {solver.eigenvalues().reverse().head(k),
          c * solver.eigenvectors().rowwise().reverse().leftCols(k)};
}

std::vector<int64_t> rows(int64_t begin, int64_t end) {
  std::vector<int64_t> result(end - begin);
  std::iota(result.begin(), result.end(), begin);
  return result;
}

void expect_same_up_to_sign(const FloatMatrix& ours, const Matrix& truth, double tolerance) {
  ASSERT_EQ(ours.n, truth.rows());
  ASSERT_EQ(ours.d, truth.cols());
  for (int64_t j = 0; j < ours.d; ++j) {
    double same = 0, opposite = 0;
    for (int64_t i = 0; i < ours.n; ++i) {
      same = std::max(same, std::abs(ours.row(i)[j] - truth(i, j)));
      opposite = std::max(opposite, std::abs(ours.row(i)[j] + truth(i, j)));
    }
    EXPECT_LT(std::min(same, opposite), tolerance) << "component " << j;
  }
}

TEST(Pca, EqualsTheCovarianceRoute) {
  const TempDir dir;
  const Matrix x = random_features(40, 25, 1);
  const FeatureFile file = stored(dir, "x.npy", x);
  const PcaResult pca = fit_pca({&file}, {.components = 8});
  const Textbook truth = textbook(x, rows(0, 40), 8);
  EXPECT_EQ(pca.rank, 8);
  EXPECT_EQ(pca.note, "");
  for (int64_t i = 0; i < 8; ++i) EXPECT_NEAR(pca.variances[i] / truth.variances[i], 1, 1e-4);
  EXPECT_NEAR(pca.total_variance, centered(x, rows(0, 40)).squaredNorm() / 39, 1e-3);
  expect_same_up_to_sign(pca.descriptors, truth.descriptors, 2e-4);
}

TEST(Pca, OneRowMoreThanATileOfProducts) {
  const TempDir dir;
  const Matrix x = random_features(513, 12, 10);
  const FeatureFile file = stored(dir, "x.npy", x);
  expect_same_up_to_sign(fit_pca({&file}, {.components = 4}).descriptors,
                         textbook(x, rows(0, 513), 4).descriptors, 1e-3);
}

TEST(Pca, FitOnSomeRowsInAnyOrderDescribesAll) {
  const TempDir dir;
  const Matrix x = random_features(50, 30, 2);
  const FeatureFile file = stored(dir, "x.npy", x);
  const std::vector<int64_t> fit = {40, 3, 7, 11, 12, 13, 30, 31, 32, 33, 1, 0, 49, 22, 21, 20};
  const PcaResult pca = fit_pca({&file}, {.components = 6, .fit_rows = fit});
  expect_same_up_to_sign(pca.descriptors, textbook(x, fit, 6).descriptors, 1e-3);
}

TEST(Pca, FewerRowsThanComponentsKeepsTheRankAndSaysSo) {
  const TempDir dir;
  const Matrix x = random_features(12, 30, 3);
  const FeatureFile file = stored(dir, "x.npy", x);
  const PcaResult pca = fit_pca({&file}, {.components = 400});
  EXPECT_EQ(pca.rank, 11);  // centering costs one
  EXPECT_EQ(pca.descriptors.d, 11);
  EXPECT_HAS(pca.note, "11 of the 400");

  Matrix flat = x;  // all on a plane: rank 2
  for (int64_t i = 0; i < 12; ++i) flat.row(i) = x.row(0) + (i % 5) * x.row(1) + (i % 3) * x.row(2);
  const FeatureFile plane = stored(dir, "plane.npy", flat);
  EXPECT_EQ(fit_pca({&plane}, {.components = 5}).rank, 2);
}

TEST(Pca, AllComponentsKeepTheCosinesOfTheCenterdFeatures) {
  const TempDir dir;
  const Matrix x = random_features(30, 200, 4);
  const FeatureFile file = stored(dir, "x.npy", x);
  const PcaResult pca = fit_pca({&file}, {.components = 29});
  ASSERT_EQ(pca.rank, 29);
  const Matrix c = centered(x, rows(0, 30));
  Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> p(
      pca.descriptors.values.data(), 30, 29);
  for (int64_t i = 0; i < 30; ++i)
    for (int64_t j = 0; j < i; ++j)
      EXPECT_NEAR(p.row(i).dot(p.row(j)) / (p.row(i).norm() * p.row(j).norm()),
                  c.row(i).dot(c.row(j)) / (c.row(i).norm() * c.row(j).norm()), 1e-4);
}

TEST(Pca, MemoryBoundChangesNothingButThePanels) {
  const TempDir dir;
  const Matrix x = random_features(20, 700, 5);
  const FeatureFile file = stored(dir, "x.npy", x);
  const PcaResult whole = fit_pca({&file}, {.components = 10});
  int64_t steps = 0, last = 0;
  PcaOptions tight{.components = 10, .memory = 17'000, .model_folder = dir / "model"};
  tight.progress = [&](int64_t done, int64_t total) {
    ++steps;
    last = done;
    EXPECT_EQ(total, 700);
  };
  const PcaResult panels = fit_pca({&file}, tight);
  EXPECT_GT(steps, 6);
  EXPECT_EQ(last, 700);
  for (size_t i = 0; i < whole.descriptors.values.size(); ++i)
    EXPECT_NEAR(whole.descriptors.values[i], panels.descriptors.values[i], 1e-3);
  tight.memory = 10'000;
  EXPECT_THROW(fit_pca({&file}, tight), UsageError);
}

TEST(Pca, ModelProjectsAsTheFitDid) {
  const TempDir dir;
  const Matrix x = random_features(60, 500, 6), turned = random_features(15, 500, 7);
  const FeatureFile file = stored(dir, "x.npy", x), second = stored(dir, "turned.npy", turned);
  for (const int64_t memory : {int64_t{1} << 30, int64_t{700'000}}) {
    // Fitted on the map's rows; the second file (case 2) is only projected.
    const PcaResult pca = fit_pca({&file, &second}, {.components = 12,
                                                     .fit_rows = rows(5, 35),
                                                     .memory = memory,
                                                     .model_folder = dir / "model"});
    const PcaModel model(dir / "model");
    EXPECT_EQ(model.components(), 12);
    EXPECT_EQ(model.dim(), 500);
    const FloatMatrix again = model.project({&file, &second}, {.memory = memory});
    ASSERT_EQ(again.values.size(), pca.descriptors.values.size());
    for (size_t i = 0; i < again.values.size(); ++i)
      EXPECT_NEAR(again.values[i], pca.descriptors.values[i], 2e-3);  // values up to 30
    EXPECT_EQ(model.project({&second}, {.components = 5}).d, 5);
    EXPECT_NEAR(model.project({&second}, {.components = 5}).row(3)[4], again.row(63)[4], 1e-4);

    const proto::Blob basis = proto::read_npy(dir / "model" / "basis.npy");
    Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> v(
        basis.data.data(), 12, 500);
    EXPECT_LT((v * v.transpose() - Eigen::MatrixXf::Identity(12, 12)).cwiseAbs().maxCoeff(), 1e-3);
  }
}

TEST(Pca, SameBitsForAnyNumberOfThreads) {
  // More rows than one tile of the Gram matrix, of the fitted and of the other scans; two panels.
  const TempDir dir;
  const int64_t n = 1200, d = 9000;
  std::mt19937 random(10);
  std::normal_distribution<float> normal;
  FeatureWriter writer(dir / "x.npy", "test", n, d);
  std::vector<float> row(static_cast<size_t>(d));
  for (int64_t i = 0; i < n; ++i) {
    for (float& value : row) value = normal(random) + 3;
    writer.append(row);
  }
  writer.finish();
  const FeatureFile file(dir / "x.npy");
  const auto run = [&](int threads) {
    return fit_pca({&file}, {.components = 20,
                             .fit_rows = rows(30, 650),
                             .threads = threads,
                             .model_folder = dir / "model"});
  };
  const PcaResult one = run(1);
  const std::string basis = read_file(dir / "model/basis.npy");
  const FloatMatrix projected = PcaModel(dir / "model").project({&file}, {.threads = 1});
  const PcaResult three = run(3);
  EXPECT_EQ(three.descriptors.values, one.descriptors.values);
  EXPECT_EQ(three.variances, one.variances);
  EXPECT_EQ(read_file(dir / "model/basis.npy"), basis);
  EXPECT_EQ(PcaModel(dir / "model").project({&file}, {.threads = 3}).values, projected.values);
  double largest = 0;
  for (size_t i = 0; i < projected.values.size(); ++i) {
    largest = std::max(largest, std::abs(double{one.descriptors.values[i]}));
    EXPECT_NEAR(projected.values[i], one.descriptors.values[i], 2e-3) << i;
  }
  EXPECT_GT(largest, 1);
}

TEST(Pca, SameInputSameSigns) {
  const TempDir dir;
  const Matrix x = random_features(25, 40, 8);
  const FeatureFile file = stored(dir, "x.npy", x);
  const PcaResult pca = fit_pca({&file}, {.components = 6});
  for (int64_t j = 0; j < 6; ++j) {
    float largest = 0;
    for (int64_t i = 0; i < 25; ++i)
      if (std::abs(pca.descriptors.row(i)[j]) > std::abs(largest))
        largest = pca.descriptors.row(i)[j];
    EXPECT_GT(largest, 0);
  }
}

TEST(Pca, RefusesNonsense) {
  const TempDir dir;
  Matrix x = random_features(6, 5, 9);
  const FeatureFile file = stored(dir, "x.npy", x),
                    other = stored(dir, "y.npy", random_features(6, 4, 9));
  EXPECT_THROW(fit_pca({}), UsageError);
  EXPECT_THROW(fit_pca({&file, &other}), InputError);
  EXPECT_THROW(fit_pca({&file}, {.components = 0}), UsageError);
  EXPECT_THROW(fit_pca({&file}, {.threads = 0}), UsageError);
  EXPECT_THROW(fit_pca({&file}, {.fit_rows = {0, 6}}), UsageError);
  EXPECT_THROW(fit_pca({&file}, {.fit_rows = {0, 0}}), UsageError);
  EXPECT_THROW(fit_pca({&file}, {.fit_rows = {3}}), UsageError);
  EXPECT_THROW(fit_pca({&file}, {.stop = [] { return true; }}), Interrupted);
  const FeatureFile same = stored(dir, "same.npy", Matrix::Constant(6, 5, 1.25));
  EXPECT_THROW(fit_pca({&same}), InputError);
  x(4, 3) = std::nan("");
  const FeatureFile bad = stored(dir, "bad.npy", x);
  expect_error<InputError>([&] { fit_pca({&bad}); }, {"bad.npy: row 4, column 3"});
}

TEST(Pca, ModelMustBeWholeAndFit) {
  const TempDir dir;
  const FeatureFile file = stored(dir, "x.npy", random_features(6, 5, 9)),
                    other = stored(dir, "y.npy", random_features(6, 4, 9));
  EXPECT_THROW(PcaModel(dir / "absent"), InputError);
  fit_pca({&file}, {.components = 2, .model_folder = dir / "model"});
  EXPECT_THROW(PcaModel(dir / "model").project({&other}), InputError);
  EXPECT_THROW(PcaModel(dir / "model").project({&file}, {.stop = [] { return true; }}),
               Interrupted);
  const float wrong[4] = {};
  proto::write_npy(dir / "model" / "mean.npy", {4}, wrong);
  EXPECT_THROW(PcaModel(dir / "model"), InputError);
  for (const float bad : {std::nanf(""), -INFINITY}) {
    const float mean[5] = {1, 2, 3, bad, 5};
    proto::write_npy(dir / "model" / "mean.npy", {5}, mean);
    expect_error<InputError>([&] { PcaModel(dir / "model"); }, {"mean.npy: value 3"});
  }
  write_file(dir / "file", "");
  EXPECT_THROW(fit_pca({&file}, {.components = 2, .model_folder = dir / "file" / "model"}), Error);
}

}  // namespace
}  // namespace revisit
