#include "sim/campaign/dose_regression.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>

#include "realtime/base/numbers/order_statistics.hpp"
#include "sim/scenario/random.hpp"

namespace fathom::sim {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;

// Solutions of one regression for any penalty.
class Ridge {
 public:
  Ridge(const MatrixXd& x, const VectorXd& y) : svd_(x, Eigen::ComputeThinU | Eigen::ComputeThinV), y_(y) {
    along_ = svd_.matrixU().transpose() * y;
  }
  [[nodiscard]] VectorXd effects(double penalty) const {
    return svd_.matrixV() * (gains(penalty).cwiseQuotient(singular()).cwiseProduct(along_));
  }
  [[nodiscard]] VectorXd residuals(double penalty) const {
    return y_ - svd_.matrixU() * gains(penalty).cwiseProduct(along_);
  }
  // Mean squared error of each dive's prediction by the others (its own mean counts as one effect).
  [[nodiscard]] double leftOutError(double penalty) const {
    const VectorXd hat = (svd_.matrixU().array().square().matrix() * gains(penalty)).array() +
                         1 / static_cast<double>(y_.size());
    return (residuals(penalty).array() / (1 - hat.array()).max(kLeastFree)).square().mean();
  }
  [[nodiscard]] VectorXd sigmas(double penalty) const {
    const double free = std::max(1.0, static_cast<double>(y_.size()) - 1 - gains(penalty).sum());
    const double variance = residuals(penalty).squaredNorm() / free;
    const VectorXd inverse = (singular().array().square() + penalty).inverse();
    return (variance * (svd_.matrixV().array().square().matrix() * inverse)).cwiseSqrt();
  }
  [[nodiscard]] double scale() const { return singular().squaredNorm() / static_cast<double>(y_.size()); }

 private:
  static constexpr double kLeastFree = 1e-3;
  [[nodiscard]] VectorXd singular() const {
    return svd_.singularValues().cwiseMax(std::numeric_limits<double>::min());
  }
  [[nodiscard]] VectorXd gains(double penalty) const {
    return singular().array().square() / (singular().array().square() + penalty);
  }
  Eigen::BDCSVD<MatrixXd> svd_;
  VectorXd y_, along_;
};

double bestPenalty(const Ridge& ridge) {
  constexpr int kTries = 25;
  double best = 0, least = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kTries; ++k) {
    const double penalty = ridge.scale() * std::pow(10, -2 + 5.0 * k / (kTries - 1)),
                 error = ridge.leftOutError(penalty);
    if (error < least) best = penalty, least = error;
  }
  return best;
}

// Products of the doses of all pairs, and what they explain of a result.
class PairProducts {
 public:
  explicit PairProducts(const MatrixXd& doses)
      : products_(doses.rows(), doses.cols() * (doses.cols() - 1) / 2) {
    for (Index a = 0, k = 0; a < doses.cols(); ++a)
      for (Index b = a + 1; b < doses.cols(); ++b, ++k) {
        products_.col(k) = doses.col(a).cwiseProduct(doses.col(b));
        products_.col(k).array() -= products_.col(k).mean();
        names_.push_back({static_cast<std::size_t>(a), static_cast<std::size_t>(b), 0.0});
      }
    squares_ = products_.colwise().squaredNorm().transpose().cwiseMax(kLeastSquares);
  }

  // Pairs that are worse together beyond what chance finds, the strongest first; takes each out of `left`
  // before it looks for the next.
  [[nodiscard]] std::vector<PairEffect> worse(VectorXd left) const {
    std::vector<PairEffect> found;
    while (found.size() < names_.size()) {
      Index strongest = 0;
      if (strengths(left).maxCoeff(&strongest) <= chance(left)) break;
      PairEffect pair = names_[static_cast<std::size_t>(strongest)];
      pair.effect = products_.col(strongest).dot(left) / squares_[strongest];
      left -= pair.effect * products_.col(strongest);
      found.push_back(pair);
    }
    return found;
  }

 private:
  static constexpr double kLeastSquares = 1e-9;

  [[nodiscard]] VectorXd strengths(const VectorXd& left) const {
    return (products_.transpose() * left).cwiseQuotient(squares_.cwiseSqrt());
  }
  // What the strongest of all pairs stays below in 19 of 20 orders of the results.
  [[nodiscard]] double chance(VectorXd left) const {
    constexpr int kOrders = 200;
    constexpr double kShare = 0.95;
    Random random(1, "orders");
    std::vector<double> strongest;
    for (int k = 0; k < kOrders; ++k) {
      for (Index i = left.size() - 1; i > 0; --i)
        std::swap(left[i], left[static_cast<Index>(random.uniform() * static_cast<double>(i + 1))]);
      strongest.push_back(strengths(left).maxCoeff());
    }
    std::sort(strongest.begin(), strongest.end());
    return quantile(strongest, kShare);
  }

  MatrixXd products_;  // dives x pairs, centred
  VectorXd squares_;
  std::vector<PairEffect> names_;
};

}  // namespace

DoseEffects regressDoses(const MatrixXd& doses, const VectorXd& result) {
  DoseEffects out;
  if (result.size() < kFewestDives) return out;
  const Eigen::RowVectorXd mean = doses.colwise().mean();
  const MatrixXd x = doses.rowwise() - mean;
  const VectorXd y = result.array() - result.mean();
  const Ridge ridge(x, y);
  const double penalty = bestPenalty(ridge);
  out.effect = ridge.effects(penalty), out.sigma = ridge.sigmas(penalty);
  out.constant = result.mean() - mean * out.effect;
  out.pairs = PairProducts(x).worse(ridge.residuals(penalty));
  return out;
}

}  // namespace fathom::sim
