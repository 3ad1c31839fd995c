#include "recon/solver/block_kernels.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::slam {
namespace {

constexpr double kSquareRounding = 1e-32;
constexpr double kLeastPivot = 1e-3;  // share of a pivot's square that may be left

}  // namespace

void addBlock(Block& c, const Block& a, double scale) {
  for (int i = 0; i < kBlockSize * kBlockSize; ++i) c.v[i] += scale * a.v[i];
}

void addTransposedProduct(Block& c, const Block& a, const Block& b) {
  for (int j = 0; j < kBlockSize; ++j) {
    for (int i = 0; i < kBlockSize; ++i) {
      double sum = 0;
      for (int k = 0; k < kBlockSize; ++k) sum += a.v[i * kBlockSize + k] * b.v[j * kBlockSize + k];
      c.v[j * kBlockSize + i] += sum;
    }
  }
}

int factorizeBlock(Block& a, double least) {
  int replaced = 0;
  for (int j = 0; j < kBlockSize; ++j) {
    double pivot = a(j, j);
    for (int k = 0; k < j; ++k) pivot -= a(j, k) * a(j, k);
    if (!(pivot >= least)) {
      pivot = least;
      ++replaced;
    }
    const double root = std::sqrt(pivot);
    a(j, j) = root;
    for (int i = j + 1; i < kBlockSize; ++i) {
      double sum = a(i, j);
      for (int k = 0; k < j; ++k) sum -= a(i, k) * a(j, k);
      a(i, j) = sum / root;
    }
    for (int i = 0; i < j; ++i) a(i, j) = 0;
  }
  return replaced;
}

void solveLower(const Block& l, double* x) {
  for (int j = 0; j < kBlockSize; ++j) {
    x[j] /= l(j, j);
    for (int i = j + 1; i < kBlockSize; ++i) x[i] -= l(i, j) * x[j];
  }
}

void solveLowerTransposed(const Block& l, double* x) {
  for (int j = kBlockSize - 1; j >= 0; --j) {
    for (int i = j + 1; i < kBlockSize; ++i) x[j] -= l(i, j) * x[i];
    x[j] /= l(j, j);
  }
}

void reflect(Block& l, Block& w, double sign, Reflections& r) {
  for (int i = 0; i < kBlockSize; ++i) {
    const double a = l(i, i);
    double square = 0;
    for (int c = 0; c < kBlockSize; ++c) square += w(i, c) * w(i, c);
    const double norm = std::sqrt(std::max(0.0, a * a + sign * square));
    const double difference = -sign * square / (a + norm);  // a - norm without its cancellation
    // Below the rounding of `a` there is nothing to reflect.
    if (!(square > kSquareRounding * a * a) || norm * norm < kLeastPivot * a * a) {
      r.tau[i] = 0;
      for (int c = 0; c < kBlockSize; ++c) r.v[i][c] = 0;
      continue;
    }
    r.tau[i] = -difference / norm;
    for (int c = 0; c < kBlockSize; ++c) r.v[i][c] = w(i, c) / difference;
    for (int row = i; row < kBlockSize; ++row) {
      double sum = 0;
      for (int c = 0; c < kBlockSize; ++c) sum += r.v[i][c] * w(row, c);
      sum = r.tau[i] * (l(row, i) + sign * sum);
      l(row, i) -= sum;
      for (int c = 0; c < kBlockSize; ++c) w(row, c) -= sum * r.v[i][c];
    }
    l(i, i) = norm;
  }
}

}  // namespace fathom::slam
