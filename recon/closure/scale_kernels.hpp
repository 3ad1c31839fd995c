#pragma once

#include "realtime/base/numbers/instruction_sets.hpp"

namespace fathom::closure::scale {

// Loops over the pixels of a scale space. Each value is made by the same operations in the same order, so
// that every instruction set gives the same floats.
struct ScaleKernels {
  // Symmetric filters: out[x] = w[0] m[x] + w[1] (m[x - 1] + m[x + 1]) + ..., with `radius` values more in
  // front of `m` and behind its n; `blurDown` from row to row, rows[radius] in the middle.
  void (*blurAlong)(const float* m, const float* w, int radius, int n, float* out);
  void (*blurDown)(const float* const* rows, const float* w, int radius, int n, float* out);
  // Of central differences at every second pixel, row[0], row[2], ...: their norm, and their direction from x
  // towards the rows above [turns, 0 to 1], within 1e-4 of a turn. Reads row[-1] too.
  void (*gradients)(const float* above, const float* row, const float* below, int n, float* strength,
                    float* turn);
  // Which of n values are farther from 0 than `quiet`, and not nearer to it than one of their eight
  // neighbours, of which a row has one more at both ends: their numbers, into `found`, and how many.
  int (*extrema)(const float* above, const float* row, const float* below, float quiet, int n, int* found);
};

FATHOM_INSTRUCTION_SETS(ScaleKernels, Kernels);

}  // namespace fathom::closure::scale
