#include "recon/slam/block_kernels.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace fathom::slam {
namespace {

constexpr int kN = kBlockSize;
constexpr double kRounding = 1e-32;   // of a square
constexpr double kLeastPivot = 1e-3;  // share of a pivot's square that may be left

// One column of a block, in vectors of two numbers that every processor has.
using Two = double __attribute__((vector_size(16)));
struct Column {
  Two a, b, c;
};

Column load(const double* p) {
  Column x;
  std::memcpy(&x, p, sizeof x);
  return x;
}

void store(double* p, const Column& x) {
  std::memcpy(p, &x, sizeof x);
}

void addTimes(Column& y, const Column& x, double s) {
  y.a += x.a * s;
  y.b += x.b * s;
  y.c += x.c * s;
}

}  // namespace

void addBlock(Block& c, const Block& a, double scale) {
  for (int i = 0; i < kN * kN; ++i) c.v[i] += scale * a.v[i];
}

void subtractProduct(Block& c, const Block& a, const Block& b) {
  Column x[kN];
  for (int k = 0; k < kN; ++k) x[k] = load(a.v + k * kN);
  for (int j = 0; j < kN; ++j) {
    Column y = load(c.v + j * kN);
    for (int k = 0; k < kN; ++k) addTimes(y, x[k], -b.v[k * kN + j]);
    store(c.v + j * kN, y);
  }
}

void addTransposedProduct(Block& c, const Block& a, const Block& b) {
  Block t;
  for (int k = 0; k < kN; ++k)
    for (int i = 0; i < kN; ++i) t.v[k * kN + i] = a.v[i * kN + k];
  for (int j = 0; j < kN; ++j) {
    Column y = load(c.v + j * kN);
    for (int k = 0; k < kN; ++k) addTimes(y, load(t.v + k * kN), b.v[j * kN + k]);
    store(c.v + j * kN, y);
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

void solveFromRight(Block& c, const Block& l) {
  Column x[kN];
  for (int j = 0; j < kN; ++j) {
    x[j] = load(c.v + j * kN);
    for (int k = 0; k < j; ++k) addTimes(x[j], x[k], -l(j, k));
    const double inverse = 1 / l(j, j);
    x[j].a *= inverse;
    x[j].b *= inverse;
    x[j].c *= inverse;
    store(c.v + j * kN, x[j]);
  }
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

void subtractTimes(double* y, const Block& a, const double* x) {
  Column sum = load(y);
  for (int k = 0; k < kN; ++k) addTimes(sum, load(a.v + k * kN), -x[k]);
  store(y, sum);
}

void subtractTransposedTimes(double* y, const Block& a, const double* x) {
  const Column right = load(x);
  for (int j = 0; j < kN; ++j) {
    const Column left = load(a.v + j * kN);
    const Two sum = left.a * right.a + left.b * right.b + left.c * right.c;
    y[j] -= sum[0] + sum[1];
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

void applyReflections(Block& l, Block& w, const Reflections& r) {
  Column x[kN];
  for (int c = 0; c < kN; ++c) x[c] = load(w.v + c * kN);
  for (int i = 0; i < kN; ++i) {
    const double sign = r.tau[i] < 0 ? -1 : 1;
    Column y = load(l.v + i * kN);
    Column sum = y;
    for (int c = 0; c < kN; ++c) addTimes(sum, x[c], sign * r.v[i][c]);
    sum.a *= r.tau[i];
    sum.b *= r.tau[i];
    sum.c *= r.tau[i];
    addTimes(y, sum, -1);
    store(l.v + i * kN, y);
    for (int c = 0; c < kN; ++c) addTimes(x[c], sum, -r.v[i][c]);
  }
  for (int c = 0; c < kN; ++c) store(w.v + c * kN, x[c]);
}

}  // namespace fathom::slam
