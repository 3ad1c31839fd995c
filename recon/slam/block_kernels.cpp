#include "recon/slam/block_kernels.hpp"

#include <algorithm>
#include <cmath>

namespace fathom::slam {
namespace {

constexpr int kN = kBlockSize;
constexpr double kRounding = 1e-32;   // of a square
constexpr double kLeastPivot = 1e-3;  // share of a pivot's square that may be left

}  // namespace

void addBlock(Block& c, const Block& a, double scale) {
  for (int i = 0; i < kN * kN; ++i) c.v[i] += scale * a.v[i];
}

void subtractProduct(Block& c, const Block& a, const Block& b) {
  for (int j = 0; j < kN; ++j)
    for (int k = 0; k < kN; ++k)
      for (int i = 0; i < kN; ++i) c.v[j * kN + i] -= a.v[k * kN + i] * b.v[j * kN + k];
}

void addTransposedProduct(Block& c, const Block& a, const Block& b) {
  for (int j = 0; j < kN; ++j) {
    for (int i = 0; i < kN; ++i) {
      double sum = 0;
      for (int k = 0; k < kN; ++k) sum += a.v[i * kN + k] * b.v[j * kN + k];
      c.v[j * kN + i] += sum;
    }
  }
}

int factorizeBlock(Block& a, double least) {
  int replaced = 0;
  for (int j = 0; j < kN; ++j) {
    double pivot = a(j, j);
    for (int k = 0; k < j; ++k) pivot -= a(j, k) * a(j, k);
    if (!(pivot >= least)) {
      pivot = least;
      ++replaced;
    }
    const double root = std::sqrt(pivot);
    a(j, j) = root;
    for (int i = j + 1; i < kN; ++i) {
      double sum = a(i, j);
      for (int k = 0; k < j; ++k) sum -= a(i, k) * a(j, k);
      a(i, j) = sum / root;
    }
    for (int i = 0; i < j; ++i) a(i, j) = 0;
  }
  return replaced;
}

void solveLower(const Block& l, double* x) {
  for (int j = 0; j < kN; ++j) {
    x[j] /= l(j, j);
    for (int i = j + 1; i < kN; ++i) x[i] -= l(i, j) * x[j];
  }
}

void solveLowerTransposed(const Block& l, double* x) {
  for (int j = kN - 1; j >= 0; --j) {
    for (int i = j + 1; i < kN; ++i) x[j] -= l(i, j) * x[i];
    x[j] /= l(j, j);
  }
}

void reflect(Block& l, Block& w, double sign, Reflections& r) {
  for (int i = 0; i < kN; ++i) {
    const double a = l(i, i);
    double square = 0;
    for (int c = 0; c < kN; ++c) square += w(i, c) * w(i, c);
    const double norm = std::sqrt(std::max(0.0, a * a + sign * square));
    const double difference = -sign * square / (a + norm);  // a - norm without its cancellation
    // Below the rounding of `a` there is nothing to reflect.
    if (!(square > kRounding * a * a) || norm * norm < kLeastPivot * a * a) {
      r.tau[i] = 0;
      for (int c = 0; c < kN; ++c) r.v[i][c] = 0;
      continue;
    }
    r.tau[i] = -difference / norm;
    for (int c = 0; c < kN; ++c) r.v[i][c] = w(i, c) / difference;
    for (int row = i; row < kN; ++row) {
      double sum = 0;
      for (int c = 0; c < kN; ++c) sum += r.v[i][c] * w(row, c);
      sum = r.tau[i] * (l(row, i) + sign * sum);
      l(row, i) -= sum;
      for (int c = 0; c < kN; ++c) w(row, c) -= sum * r.v[i][c];
    }
    l(i, i) = norm;
  }
}

}  // namespace fathom::slam
