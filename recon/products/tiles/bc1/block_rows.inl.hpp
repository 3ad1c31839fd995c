// The encoder for one instruction set: the including file defines FATHOM_KERNELS, a namespace's name, and is
// compiled for that set without contraction to fused multiply-add. Eight blocks go side by side, one a lane,
// so that every lane does the same sums in the same order whatever the vectors' width.
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <cstring>

#include "recon/products/tiles/bc1/block_rows.hpp"

namespace fathom::topside::FATHOM_KERNELS {
namespace {

constexpr int kBlocks = 8, kPixels = 16;
using Lanes = float __attribute__((vector_size(4 * kBlocks)));
using Wholes = std::int32_t __attribute__((vector_size(4 * kBlocks)));
using ByteLanes = std::uint8_t __attribute__((vector_size(kBlocks)));

constexpr int kRefinements = 2;  // a third gains less than 0.02 dB
constexpr int kIterations = 4;   // of the power method
constexpr int kBits[3] = {5, 6, 5};

#define FATHOM_INLINE [[gnu::always_inline]] inline

struct Group {
  Lanes pixel[kPixels][3];
};

struct Ends {
  Lanes colour[2][3];
};

struct Fit {
  Wholes end[2][3];      // 5, 6 and 5 bits
  Lanes level[kPixels];  // 0 the second end's colour to 3 the first's
  Lanes error;           // nine times the sum of squares
};

FATHOM_INLINE void load(const std::uint8_t* const rows[4], int first, int blocks, Group& group) {
  std::uint8_t planes[kPixels][3][kBlocks];
  for (int b = 0; b < kBlocks; ++b) {
    const int block = std::min(first + b, blocks - 1);
    for (int row = 0; row < 4; ++row) {
      const std::uint8_t* from = rows[row] + 12 * block;
      for (int column = 0; column < 4; ++column)
        for (int c = 0; c < 3; ++c) planes[4 * row + column][c][b] = from[3 * column + c];
    }
  }
  for (int k = 0; k < kPixels; ++k)
    for (int c = 0; c < 3; ++c) {
      ByteLanes bytes;
      std::memcpy(&bytes, planes[k][c], sizeof bytes);
      group.pixel[k][c] = __builtin_convertvector(bytes, Lanes);
    }
}

// Ends of the blocks' colours along their principal axes.
FATHOM_INLINE void principalEnds(const Group& group, Ends& ends) {
  const Lanes zero{};
  Lanes total[3] = {zero, zero, zero};
  Lanes rr = zero, rg = zero, rb = zero, gg = zero, gb = zero, bb = zero;
  for (const auto& p : group.pixel) {
    for (int c = 0; c < 3; ++c) total[c] += p[c];
    rr += p[0] * p[0];
    rg += p[0] * p[1];
    rb += p[0] * p[2];
    gg += p[1] * p[1];
    gb += p[1] * p[2];
    bb += p[2] * p[2];
  }
  // 256 times the covariance: differences of whole numbers below 2^24, exact.
  rr = rr * kPixels - total[0] * total[0];
  rg = rg * kPixels - total[0] * total[1];
  rb = rb * kPixels - total[0] * total[2];
  gg = gg * kPixels - total[1] * total[1];
  gb = gb * kPixels - total[1] * total[2];
  bb = bb * kPixels - total[2] * total[2];
  // Begins with the column of the greatest variance; blocks of one colour take grey.
  const Wholes green = gg > rr;
  Lanes x = green ? rg : rr, y = green ? gg : rg, z = green ? gb : rb;
  const Wholes blue = bb > (green ? gg : rr);
  x = blue ? rb : x;
  y = blue ? gb : y;
  z = blue ? bb : z;
  const Wholes flat = rr + gg + bb <= 0.0F;
  x = flat ? zero + 1 : x;
  y = flat ? zero + 1 : y;
  z = flat ? zero + 1 : z;
  for (int k = 0; k < kIterations; ++k) {
    const Lanes ax = x < 0.0F ? -x : x, ay = y < 0.0F ? -y : y, az = z < 0.0F ? -z : z;
    const Lanes most = (ax > ay ? (ax > az ? ax : az) : (ay > az ? ay : az));
    const Lanes scale = 1.0F / most, lx = x * scale, ly = y * scale, lz = z * scale;
    x = flat ? lx : rr * lx + rg * ly + rb * lz;
    y = flat ? ly : rg * lx + gg * ly + gb * lz;
    z = flat ? lz : rb * lx + gb * ly + bb * lz;
  }
  // A principal axis keeps its length times a positive variance: it cannot vanish where the block is not
  // flat.
  const Lanes ax = x < 0.0F ? -x : x, ay = y < 0.0F ? -y : y, az = z < 0.0F ? -z : z;
  const Lanes scale = 1.0F / (ax > ay ? (ax > az ? ax : az) : (ay > az ? ay : az));
  x *= scale;
  y *= scale;
  z *= scale;
  Lanes high = zero - 1e9F, low = zero + 1e9F;
  for (const auto& p : group.pixel) {
    const Lanes along = p[0] * x + p[1] * y + p[2] * z;
    high = along > high ? along : high;
    low = along < low ? along : low;
  }
  const Lanes per_length2 = 1.0F / (x * x + y * y + z * z);
  const Lanes middle = (total[0] * x + total[1] * y + total[2] * z) * (1.0F / kPixels);
  const Lanes axis[3] = {x, y, z};
  for (int c = 0; c < 3; ++c) {
    const Lanes mean = total[c] * (1.0F / kPixels);
    ends.colour[0][c] = mean + (high - middle) * per_length2 * axis[c];
    ends.colour[1][c] = mean + (low - middle) * per_length2 * axis[c];
  }
}

// For each value of a channel the two ends, as expanded, whose colour at a third from the first to
// the second is nearest: a flat block comes out within 1 where its rounded colour would be off by up to 4.
struct ThirdTable {
  std::array<std::array<std::uint8_t, 2>, 256> ends;
};

constexpr int expanded(int value, int bits) {
  return value << (8 - bits) | value >> (2 * bits - 8);
}

constexpr ThirdTable thirds(int bits) {
  ThirdTable table{};
  for (int value = 0; value < 256; ++value) {
    int least = 1 << 20;
    for (int b = 0; b < 1 << bits; ++b) {
      // The first end that comes nearest is within a step of the exact one.
      const int exact = (3 * value - expanded(b, bits)) / 2;
      const int around = exact < 0 ? 0 : exact * ((1 << bits) - 1) / 255;
      for (int a = std::max(0, around - 1); a <= std::min((1 << bits) - 1, around + 1); ++a) {
        const int first = expanded(a, bits), second = expanded(b, bits);
        const int off = 2 * first + second - 3 * value, apart = first - second;
        // Of equal ones those that are close together: hardware rounds the third differently.
        const int cost = 1024 * (off < 0 ? -off : off) + (apart < 0 ? -apart : apart);
        if (cost >= least) continue;
        least = cost;
        table.ends[static_cast<std::size_t>(value)] = {static_cast<std::uint8_t>(first),
                                                       static_cast<std::uint8_t>(second)};
      }
    }
  }
  return table;
}

constexpr ThirdTable kThirds5 = thirds(5), kThirds6 = thirds(6);

// Ends between which the blocks' mean colours are.
FATHOM_INLINE void endsOfMean(const Group& group, Ends& ends) {
  for (int c = 0; c < 3; ++c) {
    Lanes total{};
    for (const auto& p : group.pixel) total += p[c];
    const Wholes mean = __builtin_convertvector(total * (1.0F / kPixels) + 0.5F, Wholes);
    const ThirdTable& table = kBits[c] == 6 ? kThirds6 : kThirds5;
    for (int b = 0; b < kBlocks; ++b)
      for (std::size_t e = 0; e < 2; ++e)
        ends.colour[e][c][b] = table.ends[static_cast<std::size_t>(mean[b])][e];
  }
}

// Rounds the ends to the bits of the format and gives each pixel the nearest of the four colours.
FATHOM_INLINE void fitTo(const Group& group, const Ends& ends, Fit& fit) {
  const Lanes zero{};
  Lanes colour[2][3], step[3];
  for (int e = 0; e < 2; ++e)
    for (int c = 0; c < 3; ++c) {
      const auto most = static_cast<float>((1 << kBits[c]) - 1);
      Lanes value = ends.colour[e][c];
      value = value > 0.0F ? value : zero;
      value = value < 255.0F ? value : zero + 255;
      const Wholes bits = __builtin_convertvector(value * (most / 255) + 0.5F, Wholes);
      fit.end[e][c] = bits;
      colour[e][c] = __builtin_convertvector((bits << (8 - kBits[c])) | (bits >> (2 * kBits[c] - 8)), Lanes);
    }
  for (int c = 0; c < 3; ++c) step[c] = colour[0][c] - colour[1][c];
  const Lanes length2 = step[0] * step[0] + step[1] * step[1] + step[2] * step[2];
  const Lanes scale = length2 > 0.0F ? 3.0F / length2 : zero;
  fit.error = zero;
  for (int k = 0; k < kPixels; ++k) {
    const Lanes r = group.pixel[k][0] - colour[1][0], g = group.pixel[k][1] - colour[1][1],
                b = group.pixel[k][2] - colour[1][2];
    const Lanes along = (r * step[0] + g * step[1] + b * step[2]) * scale;
    const Lanes level = __builtin_convertvector(-((along > 0.5F) + (along > 1.5F) + (along > 2.5F)), Lanes);
    const Lanes off_r = 3.0F * r - level * step[0], off_g = 3.0F * g - level * step[1],
                off_b = 3.0F * b - level * step[2];
    fit.level[k] = level;
    fit.error += off_r * off_r + off_g * off_g + off_b * off_b;
  }
}

// The ends that fit the pixels best while each keeps its level (least squares); they stay where one level
// alone is in use.
FATHOM_INLINE void refit(const Group& group, const Fit& fit, Ends& ends) {
  const Lanes zero{};
  Lanes aa = zero, ab = zero, bb = zero;
  Lanes a[3] = {zero, zero, zero}, all[3] = {zero, zero, zero};
  for (int k = 0; k < kPixels; ++k) {
    const Lanes level = fit.level[k], rest = 3.0F - level;
    aa += level * level;
    ab += level * rest;
    bb += rest * rest;
    for (int c = 0; c < 3; ++c) {
      a[c] += level * group.pixel[k][c];
      all[c] += group.pixel[k][c];
    }
  }
  const Lanes determinant = aa * bb - ab * ab;
  const Wholes solvable = determinant > 0.0F;
  const Lanes scale = 3.0F / (solvable ? determinant : zero + 1);
  for (int c = 0; c < 3; ++c) {
    const Lanes b = 3.0F * all[c] - a[c];
    ends.colour[0][c] = solvable ? (a[c] * bb - b * ab) * scale : ends.colour[0][c];
    ends.colour[1][c] = solvable ? (b * aa - a[c] * ab) * scale : ends.colour[1][c];
  }
}

FATHOM_INLINE void keepBetter(const Fit& next, Fit& best) {
  const Wholes better = next.error < best.error;
  best.error = better ? next.error : best.error;
  for (int e = 0; e < 2; ++e)
    for (int c = 0; c < 3; ++c) best.end[e][c] = better ? next.end[e][c] : best.end[e][c];
  for (int k = 0; k < kPixels; ++k) best.level[k] = better ? next.level[k] : best.level[k];
}

FATHOM_INLINE void emit(const Fit& fit, int count, std::uint8_t* out) {
  Wholes word[2], indices{};
  for (int e = 0; e < 2; ++e) word[e] = (fit.end[e][0] << 11) | (fit.end[e][1] << 5) | fit.end[e][2];
  for (int k = 0; k < kPixels; ++k) {  // level 3 is index 0, 0 is 1, 2 is 2, 1 is 3
    const Wholes level = __builtin_convertvector(fit.level[k], Wholes);
    const Wholes index = ((level == 0) & 1) | ((level == 2) & 2) | ((level == 1) & 3);
    indices |= index << (2 * k);
  }
  // Four colours are in use only where the first word is the greater; equal words stand for one colour.
  const Wholes swapped = word[0] < word[1], equal = word[0] == word[1];
  const Wholes first = swapped ? word[1] : word[0], second = swapped ? word[0] : word[1];
  indices ^= swapped & 0x55555555;
  indices &= ~equal;
  for (int b = 0; b < count; ++b) {
    const auto ends = static_cast<std::uint32_t>(first[b] | second[b] << 16);
    const auto levels = static_cast<std::uint32_t>(indices[b]);
    for (int k = 0; k < 4; ++k) {
      out[8 * b + k] = static_cast<std::uint8_t>(ends >> (8 * k));
      out[8 * b + 4 + k] = static_cast<std::uint8_t>(levels >> (8 * k));
    }
  }
}

#undef FATHOM_INLINE

void compressBlockRow(const std::uint8_t* const rows[4], int blocks, std::uint8_t* out) {
  for (int first = 0; first < blocks; first += kBlocks) {
    Group group;
    Ends ends;
    Fit best, next;
    load(rows, first, blocks, group);
    principalEnds(group, ends);
    fitTo(group, ends, best);
    for (int k = 0; k < kRefinements; ++k) {
      refit(group, k == 0 ? best : next, ends);
      fitTo(group, ends, next);
      keepBetter(next, best);
    }
    endsOfMean(group, ends);
    fitTo(group, ends, next);
    keepBetter(next, best);
    emit(best, std::min(kBlocks, blocks - first), out + 8 * first);
  }
}

}  // namespace

CompressBlockRow table() {
  return compressBlockRow;
}

}  // namespace fathom::topside::FATHOM_KERNELS
