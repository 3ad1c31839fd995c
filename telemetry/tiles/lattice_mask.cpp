#include "telemetry/tiles/lattice_mask.hpp"

#include <algorithm>
#include <bit>

namespace fathom::telemetry {
namespace {

unsigned gammaBits(std::size_t value) {
  return 2 * static_cast<unsigned>(std::bit_width(value)) - 1;
}

// Calls visit(length) for each run; lengths are of unseen, seen, unseen, ... nodes, the first may be 0.
template <class Visit>
void forEachRun(std::span<const bool> seen, Visit visit) {
  bool value = false;
  std::size_t begin = 0;
  for (std::size_t i = 0; i <= seen.size(); ++i) {
    if (i < seen.size() && seen[i] == value) continue;
    visit(i - begin);
    begin = i;
    value = !value;
  }
}

}  // namespace

void putMask(BitWriter& writer, std::span<const bool> seen) {
  const bool full = std::all_of(seen.begin(), seen.end(), [](bool s) { return s; });
  writer.put(full ? 1 : 0, 1);
  if (full) return;
  std::size_t run_bits = 0;
  forEachRun(seen, [&](std::size_t length) { run_bits += gammaBits(length + 1); });
  const bool runs = run_bits < seen.size();
  writer.put(runs ? 1 : 0, 1);
  if (!runs) {
    for (const bool s : seen) writer.put(s ? 1 : 0, 1);
    return;
  }
  forEachRun(seen, [&](std::size_t length) {
    const unsigned width = static_cast<unsigned>(std::bit_width(length + 1));
    writer.put(0, width - 1);
    writer.put(length + 1, width);
  });
}

bool getMask(BitReader& reader, std::span<bool> seen) {
  if (reader.get(1) == 1) {
    std::fill(seen.begin(), seen.end(), true);
    return reader.ok();
  }
  if (reader.get(1) == 0) {
    for (bool& s : seen) s = reader.get(1) == 1;
    return reader.ok();
  }
  bool value = false;
  for (std::size_t i = 0; i < seen.size(); value = !value) {
    unsigned zeros = 0;
    while (reader.ok() && reader.get(1) == 0 && ++zeros < 16) {
    }
    if (!reader.ok() || zeros >= 16) return false;
    const std::size_t length = (std::size_t{1} << zeros | reader.get(zeros)) - 1;
    if (!reader.ok() || length > seen.size() - i || (length == 0 && i > 0)) return false;
    std::fill_n(seen.begin() + static_cast<std::ptrdiff_t>(i), length, value);
    i += length;
  }
  return true;
}

}  // namespace fathom::telemetry
