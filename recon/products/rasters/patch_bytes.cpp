#include <isa-l/igzip_lib.h>

#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "recon/products/rasters/layer_patch.hpp"

namespace fathom::topside {
namespace {

constexpr std::array<char, 8> kMagic = {'F', 'P', 'A', 'T', 'C', 'H', '0', '1'};
constexpr double kUnit = 1e-4;             // of heights and sigma [m]
constexpr std::int32_t kMaxEdge = 32'768;  // of a window [cells]: more is no patch
constexpr std::size_t kSurfaceBytes = 9;   // a cell: mask, height (4 planes), sigma (2), views (2)
constexpr std::size_t kMosaicBytes = 4;

struct Head {
  std::array<char, 8> magic = kMagic;
  std::int32_t level = 0, x = 0, y = 0, unused = 0;
  LayerCells cells;
  CellWindow surface, mosaic;
  std::uint32_t surface_bytes = 0, mosaic_bytes = 0;
};
static_assert(std::is_trivially_copyable_v<Head> && sizeof(Head) == 80);

[[noreturn]] void refusePatch() {
  throw std::runtime_error("not a tile's layer patch, or a damaged one");
}

std::vector<std::uint8_t> deflated(const std::vector<std::uint8_t>& raw) {
  std::vector<std::uint8_t> out(raw.size() + raw.size() / 8 + 1024), work(ISAL_DEF_LVL1_DEFAULT);
  isal_zstream stream{};
  isal_deflate_stateless_init(&stream);
  stream.level = 1;
  stream.level_buf = work.data();
  stream.level_buf_size = static_cast<std::uint32_t>(work.size());
  stream.end_of_stream = 1;
  stream.next_in = const_cast<std::uint8_t*>(raw.data());
  stream.avail_in = static_cast<std::uint32_t>(raw.size());
  stream.next_out = out.data();
  stream.avail_out = static_cast<std::uint32_t>(out.size());
  if (isal_deflate_stateless(&stream) != COMP_OK) throw std::runtime_error("a layer patch does not deflate");
  out.resize(stream.total_out);
  return out;
}

std::vector<std::uint8_t> inflated(std::span<const std::uint8_t> bytes, std::size_t raw_size) {
  std::vector<std::uint8_t> raw(raw_size);
  inflate_state state{};
  isal_inflate_init(&state);
  state.next_in = const_cast<std::uint8_t*>(bytes.data());
  state.avail_in = static_cast<std::uint32_t>(bytes.size());
  state.next_out = raw.data();
  state.avail_out = static_cast<std::uint32_t>(raw.size());
  if (isal_inflate_stateless(&state) != ISAL_DECOMP_OK || state.total_out != raw_size) refusePatch();
  return raw;
}

// Byte `place` of `value`, to the plane of that byte.
template <typename T>
void putPlanes(std::uint8_t* planes, std::size_t cells, std::size_t cell, T value) {
  for (std::size_t k = 0; k < sizeof value; ++k)
    planes[k * cells + cell] = static_cast<std::uint8_t>(value >> (8 * k));
}
template <typename T>
T takePlanes(const std::uint8_t* planes, std::size_t cells, std::size_t cell) {
  T value = 0;
  for (std::size_t k = 0; k < sizeof value; ++k)
    value = static_cast<T>(value | static_cast<T>(static_cast<T>(planes[k * cells + cell]) << (8 * k)));
  return value;
}

constexpr std::uint8_t kKnown = 1, kSigmaKnown = 2;

std::vector<std::uint8_t> surfaceBytes(const LayerPatch& patch) {
  const std::size_t n = patch.surface.cells();
  std::vector<std::uint8_t> raw(kSurfaceBytes * n);
  std::int32_t before = 0;
  for (std::size_t k = 0; k < n; ++k) {
    const float up = patch.elevation[k], sigma = patch.sigma[k];
    if (!(std::abs(up) < 1e5F)) continue;  // 0.1 mm in 32 bits
    const auto height = static_cast<std::int32_t>(std::lround(static_cast<double>(up) / kUnit));
    const auto step = static_cast<std::uint32_t>(height) - static_cast<std::uint32_t>(before);
    const auto folded = (step << 1) ^ (0U - (step >> 31));  // small steps of either sign in few bytes
    before = height;
    raw[k] = kKnown;
    putPlanes(&raw[n], n, k, folded);
    if (std::isfinite(sigma)) {
      raw[k] |= kSigmaKnown;
      const double most = std::numeric_limits<std::uint16_t>::max();
      putPlanes(&raw[5 * n], n, k,
                static_cast<std::uint16_t>(std::clamp(static_cast<double>(sigma) / kUnit + 0.5, 0.0, most)));
    }
    putPlanes(&raw[7 * n], n, k, patch.views[k]);
  }
  return raw;
}

void takeSurface(const std::vector<std::uint8_t>& raw, LayerPatch& patch) {
  const std::size_t n = patch.surface.cells();
  patch.elevation.assign(n, kNoValue);
  patch.sigma.assign(n, kNoValue);
  patch.views.assign(n, 0);
  std::uint32_t height = 0;
  for (std::size_t k = 0; k < n; ++k) {
    if ((raw[k] & kKnown) == 0) continue;
    const auto folded = takePlanes<std::uint32_t>(&raw[n], n, k);
    height += (folded >> 1) ^ (0U - (folded & 1));
    patch.elevation[k] = static_cast<float>(static_cast<std::int32_t>(height) * kUnit);
    if ((raw[k] & kSigmaKnown) != 0)
      patch.sigma[k] = static_cast<float>(takePlanes<std::uint16_t>(&raw[5 * n], n, k) * kUnit);
    patch.views[k] = takePlanes<std::uint16_t>(&raw[7 * n], n, k);
  }
}

// Planes of alpha, green, and red and blue less green, each less the one before it.
std::vector<std::uint8_t> mosaicBytes(const LayerPatch& patch) {
  const std::size_t n = patch.mosaic.cells();
  std::vector<std::uint8_t> raw(kMosaicBytes * n);
  std::array<std::uint8_t, 3> before{};
  for (std::size_t k = 0; k < n; ++k) {
    const std::uint8_t* rgba = &patch.rgba[4 * k];
    raw[k] = rgba[3];
    if (rgba[3] == 0) continue;
    const std::array<std::uint8_t, 3> now = {rgba[1], static_cast<std::uint8_t>(rgba[0] - rgba[1]),
                                             static_cast<std::uint8_t>(rgba[2] - rgba[1])};
    for (std::size_t c = 0; c < 3; ++c) raw[(c + 1) * n + k] = static_cast<std::uint8_t>(now[c] - before[c]);
    before = now;
  }
  return raw;
}

void takeMosaic(const std::vector<std::uint8_t>& raw, LayerPatch& patch) {
  const std::size_t n = patch.mosaic.cells();
  patch.rgba.assign(4 * n, 0);
  std::array<std::uint8_t, 3> now{};
  for (std::size_t k = 0; k < n; ++k) {
    if (raw[k] == 0) continue;
    for (std::size_t c = 0; c < 3; ++c) now[c] = static_cast<std::uint8_t>(now[c] + raw[(c + 1) * n + k]);
    std::uint8_t* rgba = &patch.rgba[4 * k];
    rgba[0] = static_cast<std::uint8_t>(now[1] + now[0]);
    rgba[1] = now[0];
    rgba[2] = static_cast<std::uint8_t>(now[2] + now[0]);
    rgba[3] = raw[k];
  }
}

bool believable(const CellWindow& window) {
  return window.rows >= 0 && window.rows <= kMaxEdge && window.columns >= 0 && window.columns <= kMaxEdge &&
         window.cells() < (std::size_t{1} << 28);
}

}  // namespace

std::vector<std::uint8_t> packLayerPatch(const LayerPatch& patch) {
  const std::vector<std::uint8_t> surface = deflated(surfaceBytes(patch)),
                                  mosaic = deflated(mosaicBytes(patch));
  Head head;
  head.level = patch.tile.level;
  head.x = patch.tile.x;
  head.y = patch.tile.y;
  head.cells = patch.cells;
  head.surface = patch.surface;
  head.mosaic = patch.mosaic;
  head.surface_bytes = static_cast<std::uint32_t>(surface.size());
  head.mosaic_bytes = static_cast<std::uint32_t>(mosaic.size());
  std::vector<std::uint8_t> bytes(sizeof head);
  std::memcpy(bytes.data(), &head, sizeof head);
  bytes.insert(bytes.end(), surface.begin(), surface.end());
  bytes.insert(bytes.end(), mosaic.begin(), mosaic.end());
  return bytes;
}

LayerPatch unpackLayerPatch(std::span<const std::uint8_t> bytes, PatchPart part) {
  Head head;
  if (bytes.size() < sizeof head) refusePatch();
  std::memcpy(&head, bytes.data(), sizeof head);
  bytes = bytes.subspan(sizeof head);
  if (head.magic != kMagic || !believable(head.surface) || !believable(head.mosaic) ||
      bytes.size() != std::size_t{head.surface_bytes} + head.mosaic_bytes)
    refusePatch();
  LayerPatch patch;
  patch.tile = {head.level, head.x, head.y};
  patch.cells = head.cells;
  patch.surface = head.surface;
  patch.mosaic = head.mosaic;
  if (part != PatchPart::kMosaic)
    takeSurface(inflated(bytes.first(head.surface_bytes), kSurfaceBytes * patch.surface.cells()), patch);
  if (part != PatchPart::kSurface)
    takeMosaic(inflated(bytes.subspan(head.surface_bytes), kMosaicBytes * patch.mosaic.cells()), patch);
  return patch;
}

}  // namespace fathom::topside
